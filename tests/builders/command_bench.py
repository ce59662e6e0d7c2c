"""A folder with a sound cloud, and commands run there on bad inputs as a user runs them, within limits."""

from __future__ import annotations

import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest
from slopewatch.tests.builders.bad_inputs import sound
from slopewatch.tests.builders.program import run

MEMORY_B, PROCESSOR_S = 4 << 30, 60
COARSE = ("--cell", "0.5", "--zone-profiles", "0")
COMMANDS: dict[str, tuple[str, ...]] = {
    "info": ("info", "BAD"),
    "ground": ("ground", "BAD", "--output", "OUT/g.laz"),
    "register": ("register", "GOOD", "BAD", "--output", "OUT/a.laz"),
    "change": (
        "change", "GOOD", "BAD", "--epoch-from", "2024-05-01", "--epoch-to", "2025-05-01", *COARSE,
        "--output-dir", "OUT/c",
    ),
    "m3c2": ("m3c2", "GOOD", "BAD", "--output", "OUT/m.laz"),
    "screen": ("screen", "BAD", "--screening-method", "filter", "--output", "OUT/s.laz"),
    "inspect": (
        "inspect", "--epoch", "2024-05-01=GOOD", "--epoch", "2025-05-01=BAD", "--cell", "0.5", "--output-dir", "OUT/i",
    ),
    "series": (
        "series", "--epoch", "2024-05-01=GOOD", "--epoch", "2025-05-01=BAD", "--ground-ready", "--cell", "0.5",
        "--output-dir", "OUT/s",
    ),
    "train": ("train", "BAD", "GOOD", "--output-dir", "OUT/t"),
}  # fmt: skip
NO_OTHER = ("info", "ground", "screen")
"""Commands that take one cloud."""


class Bench:
    """A folder with the sound cloud, a folder for outputs, and commands run in them."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.out = folder, folder / "out"
        self.out.mkdir()
        self.good = sound(folder / "2024-05-01.laz")

    def run(self, *words: object, **limits: int) -> subprocess.CompletedProcess[str]:
        return run(*words, limits={"AS": MEMORY_B, "CPU": PROCESSOR_S, **limits})

    def with_bad(self, command: str, bad: Path) -> list[str]:
        known = {"GOOD": str(self.good), "BAD": str(bad), "OUT": str(self.out)}
        words = list(COMMANDS[command])
        for name, path in known.items():
            words = [word.replace(name, path) for word in words]
        return words

    def refused(self, *words: object, says: tuple[str, ...] = (), **limits: int) -> str:
        """The one sentence of a refusal; it holds one of ``says``, and nothing is left."""
        before = sorted(self.folder.rglob("*"))
        done = self.run(*words, **limits)
        lines = done.stderr.strip().splitlines()
        assert done.returncode == 2, (words, done.returncode, lines)
        assert "Traceback" not in done.stderr
        sentences = [line for line in lines if line.startswith("Error: ")]
        assert sentences == lines[-1:], lines
        assert sentences[0].endswith((".", "?)")), lines
        assert not says or any(word in sentences[0] for word in says), (says, sentences)
        assert sorted(self.folder.rglob("*")) == before, "something was left behind"
        return sentences[0]

    def fine(self, *words: object, says: tuple[str, ...] = ()) -> str:
        """What a command says that ends well."""
        done = self.run(*words)
        assert done.returncode == 0, (words, done.stderr)
        assert "Traceback" not in done.stderr
        said = done.stderr + done.stdout
        assert not says or any(word in said for word in says), (says, said)
        assert not list(self.out.rglob(".*"))
        return said

    def bounded(self, command: str, bad: Path) -> None:
        """Either of the two; what a command can still say of so little differs."""
        words = self.with_bad(command, bad)
        done = self.run(*words)
        assert done.returncode in (0, 2), (words, done.stderr)
        assert "Traceback" not in done.stderr
        if done.returncode == 2:
            assert done.stderr.strip().splitlines()[-1].startswith("Error: ")
            assert not list(self.out.rglob("*"))


@pytest.fixture
def bench(tmp_path: Path) -> Bench:
    return Bench(tmp_path)


Case = Callable[[Bench], None]
Cases = dict[int, list[Case]]


def case(cases: Cases, number: int) -> Callable[[Case], Case]:
    """The function tests case ``number`` of the list and is put into ``cases``."""

    def keep(function: Case) -> Case:
        cases.setdefault(number, []).append(function)
        return function

    return keep


def each(cases: Cases) -> list[tuple[int, Case]]:
    """For parametrising: number and function."""
    return [(number, function) for number, many in sorted(cases.items()) for function in many]
