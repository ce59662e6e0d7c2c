"""Places tried, kept in a folder: a run that was stopped goes on where it was, and a further detector is added alone.

A place's file is named by its points, the number of hazards and what draws them; a detector's by that and its own key
(the weights' SHA-256). Changes of code are not noticed: delete the folder after one.
"""

from __future__ import annotations

import hashlib
import json
import re
import sys
import time
from collections.abc import Iterator, Mapping
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np

from ...engine.core.arrays import Float32
from . import screening_trials as trials
from .screening_ground import Place
from .screening_trials import Detector, Lattice, PlaceResult, Trial, answer, try_place


class KeptAnswers(Mapping[str, Float32]):
    """Scores by detector that are read when they are asked for."""

    def __init__(self, files: Mapping[str, Path]) -> None:
        self._files = dict(files)

    def __getitem__(self, name: str) -> Float32:
        with np.load(self._files[name], allow_pickle=False) as kept:
            return np.asarray(kept[f"scores {name}"])

    def __iter__(self) -> Iterator[str]:
        return iter(self._files)

    def __len__(self) -> int:
        return len(self._files)


def place_key(place: Place, count: int, seed: int = 0) -> str:
    """What a place's scenes are made of, as a hash."""
    settings = (place.name, place.group, place.kind, count, seed, trials.HEIGHTS_M, trials.FILLED)
    diameters = (trials.DIAMETERS_M, trials.ELEVATION_DIAMETERS_M)
    made = hashlib.sha256(repr((settings, diameters)).encode())
    made.update(np.ascontiguousarray(place.flat).tobytes())
    return made.hexdigest()[:16]


def kept_place(folder: Path | None, place: Place, detectors: Mapping[str, Detector], count: int) -> PlaceResult:
    """A place tried with the filters and with ``detectors`` (by name, which says what they are), from ``folder`` as far
    as it is there; without a folder it stays in memory.
    """
    if folder is None:
        return replace(try_place(place, list(detectors.values()), count), key=place_key(place, count))
    folder.mkdir(parents=True, exist_ok=True)
    key = place_key(place, count)
    stem = f"{re.sub(r'[^A-Za-z0-9]+', '_', place.name)}-{key}"
    first = folder / f"{stem}.npz"
    if not first.is_file():
        _write_place(first, _timed(f"{place.name}: hazards and filters", lambda: try_place(place, [], count)))
    result = _read_place(first, place, key)
    files = dict.fromkeys(result.answers, first)
    for name, detector in detectors.items():
        path = folder / f"{stem}-{re.sub(r'[^A-Za-z0-9]+', '_', name)}.npz"
        if not path.is_file():
            found = _timed(f"{place.name}: {name}", lambda one=detector: answer(result, one, count))
            _write(path, {f"scores {made}": scores for made, scores in found.items()})
        files[name] = path
    return replace(result, answers=KeptAnswers(files))


def _timed(title: str, work: Any) -> Any:
    started = time.perf_counter()
    found = work()
    print(f"{title}: {time.perf_counter() - started:.1f} s", file=sys.stderr, flush=True)
    return found


def _write(path: Path, arrays: Mapping[str, Any]) -> None:
    """Under its name only when it is whole."""
    part = path.with_suffix(".part.npz")
    np.savez_compressed(part, **arrays)
    part.replace(path)


def _write_place(path: Path, result: PlaceResult) -> None:
    listed = [{**asdict(one), "cells": one.cells.tolist()} for one in result.trials]
    facts = {"needed": result.needed, "scenes": result.scenes, "cell": result.lattice.cell, "trials": listed}
    arrays = {f"scores {name}": scores for name, scores in result.answers.items()}
    lattice = {"origin": result.lattice.origin, "covered": result.lattice.covered}
    _write(path, {"facts": np.array(json.dumps(facts)), **lattice, **arrays})


def _read_place(path: Path, place: Place, key: str) -> PlaceResult:
    with np.load(path, allow_pickle=False) as kept:
        facts = json.loads(str(kept["facts"]))
        lattice = Lattice(kept["origin"], float(facts["cell"]), kept["covered"])
        names = [name.removeprefix("scores ") for name in kept.files if name.startswith("scores ")]
    found = [
        Trial(**{**one, "where": tuple(one["where"]), "cells": np.array(one["cells"], dtype=np.int64)})
        for one in facts["trials"]
    ]
    answers = KeptAnswers(dict.fromkeys(names, path))
    return PlaceResult(place, lattice, facts["needed"], facts["scenes"], found, answers, key)
