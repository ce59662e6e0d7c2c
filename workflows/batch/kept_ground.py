"""The ground that ``inspect`` found for a slope, put where its series looks: the third survey makes a series of a pair.

A series finds what it keeps by a key of all that it depends on (``ground_key``). So nothing is compared here: the
ground is put there under the key of what it was made of, and is used only where the series would make the same.
"""

from __future__ import annotations

import contextlib
import shutil
from pathlib import Path
from typing import Any

from ...engine.core.checksums import sha256
from ...engine.core.errors import InputError
from ...engine.core.input_files import read_input
from ...engine.core.json_shapes import parse_json
from ...engine.core.staged_outputs import atomic_output
from ...engine.core.version import VERSION
from ...interface.input_files import RECORD
from ..series_preparation import GROUND, ground_facts, ground_key
from ..series_store import FOLDER, names_of, write_facts

_ENDINGS = ("classified.laz", "clipped.laz", "clip.json", "cloth.json", "select.json")
"""What an extraction writes beside the ground; the pipelines name their files."""


def keep_ground(inspected: Path, series: Path) -> int:
    """Put the ground of the surveys that ``inspected`` holds into what the series in ``series`` keeps.

    What is there already, was changed, or cannot be read or copied is left out: the series makes its own.

    Returns:
        Surveys whose ground was put there.
    """
    count = 0
    with contextlib.suppress(InputError, OSError, ValueError, KeyError, TypeError, AttributeError):
        record = parse_json(read_input(inspected / "run.json", RECORD))
        if record["software"] != f"SlopeWatch {VERSION}" or record["command"] != "inspect":
            return 0
        if record.get("corrections"):  # what is there is not what an extraction found
            return 0
        for day, facts in _grounds(record).items():
            count += _keep(inspected, series / FOLDER, _key(record, day), facts)
    return count


def _grounds(record: dict[str, Any]) -> dict[str, dict[str, Any]]:
    """Facts of the extraction by survey."""
    (stage,) = (stage for stage in record["stages"] if stage["stage"] == "ground")
    return {str(day): dict(facts) for day, facts in stage["epochs"].items()}


def _key(record: dict[str, Any], day: str) -> str:
    hashes = {str(entry["role"]): str(entry["sha256"]) for entry in record["inputs"]}
    parameters = record["parameters"]
    return ground_key(
        hashes[f"epoch {day}"],
        hashes.get("roi", ""),
        dict(parameters["inputs"]),
        dict(parameters["ground"]),
        record["pdal"]["version"],
    )


def _keep(inspected: Path, work: Path, key: str, facts: dict[str, Any]) -> bool:
    """Copy one survey's files, those that say that it is there last; False where it is not to be used."""
    ground = inspected / str(facts["ground"])
    file, sidecar = names_of(GROUND, key)
    if facts.get("shared_points"):  # nor is ground that another survey helped to find
        return False
    if (work / sidecar).exists() or not ground.resolve().is_relative_to(inspected.resolve()):
        return False
    if sha256(ground) != facts["sha256"]:  # somebody has changed it
        return False
    work.mkdir(parents=True, exist_ok=True)
    before, after = (str(place).removesuffix("ground.laz") for place in (ground, work / file))
    for ending in _ENDINGS:
        if Path(before + ending).is_file():
            _copy(Path(before + ending), Path(after + ending), before, after)
    _copy(ground, work / file, before, after)
    kept = ground_facts(dict(facts["figures"]), facts, f"{FOLDER}/{key}_classified.laz")
    with atomic_output(work / sidecar) as partial:
        write_facts(partial, facts["sha256"], kept)
    return True


def _copy(source: Path, target: Path, before: str, after: str) -> None:
    with atomic_output(target) as partial:
        if source.suffix == ".json":
            text = source.read_text(encoding="utf-8")
            partial.write_text(text.replace(before, after), encoding="utf-8")
        else:
            shutil.copyfile(source, partial)
