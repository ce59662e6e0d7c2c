"""A kind of file that is fuzzed: a sound one, how it is changed, and the command that reads it."""

from __future__ import annotations

import hashlib
import json
import random
import re
import shutil
from dataclasses import dataclass
from pathlib import Path

from slopewatch.lab.fuzz.mutations import Mutation
from slopewatch.lab.fuzz.trial import run_apart


@dataclass(frozen=True)
class Target:
    """``seed`` is a sound file, ``command`` reads a changed copy of it.

    Args:
        command: words in which FILE stands for the changed file, FOLDER for a copy of ``beside`` that holds it in
            the place of ``seed``, and OUT for a folder for outputs.
        beside: folder that is copied for each trial; None where the file stands alone.
        named: words one of which a refusal must hold; the file's own name and folder always count.
        pinned: JSON file in FOLDER whose ``sha256`` is put right for the changed file.
    """

    name: str
    seed: Path
    change: Mutation
    command: tuple[str, ...]
    beside: Path | None = None
    pinned: str = ""
    named: tuple[str, ...] = ()

    def prepare(self, folder: Path, rng: random.Random) -> tuple[Path, list[str]]:
        """The changed file, in ``folder``, and the words of the command."""
        data = self.change(self.seed.read_bytes(), rng)
        place, out = folder / "in", folder / "out"
        out.mkdir()
        if self.beside is None:
            place.mkdir()
        else:
            shutil.copytree(self.beside, place)
        file = place / self.seed.name
        file.write_bytes(data)
        if self.pinned:
            description = place / self.pinned
            document = json.loads(description.read_text(encoding="utf-8"))
            document["sha256"] = hashlib.sha256(data).hexdigest()
            description.write_text(json.dumps(document), encoding="utf-8")
        known = {"FILE": str(file), "FOLDER": str(place), "OUT": str(out)}
        words = [re.sub("^(FILE|FOLDER|OUT)(?=/|$)", lambda m: known[m[0]], word) for word in self.command]
        return file, words


def sound(result: Path, *words: str) -> None:
    """Run a command on what is sound, unless its result is there from an earlier run."""
    if result.exists():
        return
    done = run_apart(list(words))
    if done.code != 0:
        raise RuntimeError(f"slopewatch {' '.join(words)} ended with {done.code}: {done.error}")
