#!/usr/bin/env python3
"""Kill commands at every rename of their replacement: ``lab/kills/kills_at_renames.py [change|series|... ...]``.

A command runs into a folder, a zone of its table is reviewed, and the command runs again there with another setting.
When that run puts its journal on the disk, it is forked for n = 1, 2, ...: the fork goes on and ends by SIGKILL before
its n-th rename or removal, until one goes on to its end. After each kill the next command looks at one of the folders,
in turn a run that is refused and one that reads the results. Then all folders must hold, byte for byte, the earlier
results or the new ones, and nothing hidden; the review must be there. At the kill before the last rename, the most that
can be put back, the next command is killed at each of its own renames as well. Kills before the journal is written are
tried on a copy of the folders. The exit code is 1 if anything was found.
"""

from __future__ import annotations

import argparse
import contextlib
import fcntl
import json
import os
import runpy
import shutil
import signal
import sqlite3
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
CALLS = ("replace", "rename", "unlink", "remove", "rmdir")
REMARK = "looked at on site"
TABLES = ("zones.gpkg", "series.gpkg", "screened_zones.gpkg")
READING_EVERY = 8  # kills; the other next commands are refused as soon as they have looked at the folder
Tree = dict[str, bytes]


@dataclass(frozen=True)
class Case:
    """A command, what its second run is given in addition, the folders it writes to, what reads its results, and what
    is refused because of them.
    """

    words: list[str]
    again: list[str]
    folders: list[str]
    reading: list[str]
    refused: list[str]

    def next_command(self, folder: str, number: int) -> list[str]:
        """What looks at a folder after the kill of that number."""
        if self.reading and folder == self.folders[0] and number % READING_EVERY == 0:
            return self.reading
        return self.refused if folder == self.folders[0] and self.refused else ["report", folder]


def cases(place: Path) -> dict[str, Case]:
    """Each command that replaces results, on small sound clouds; its outputs lie in ``place``/NAME and NAME-other."""
    from kills import surveys

    clouds = [str(path) for path in surveys(place)]
    models = [str(elevation_model(place / f"{2023 + n}-05-01.tif", 0.6 * n, n)) for n in (1, 2)]
    epochs = [f"--epoch={Path(path).stem}={path}" for path in clouds]
    found = {}

    def add(name: str, words: list[str], again: list[str], reading: tuple[str, ...] = ()) -> None:
        out, other = str(place / name), str(place / f"{name}-other")
        filled = [word.format(out=out, other=other) for word in [name, *words]]
        uses_other = any(other in word for word in filled)
        read = [word.format(out=out, place=place) for word in reading]
        refused = ["change", *clouds[:2], "--output-dir", out] if "--overwrite" in again else []
        found[name] = Case(filled, again, [out, other] if uses_other else [out], read, refused)

    into = ["--output-dir", "{out}"]
    coarse = ["--cell", "0.6", "--overwrite"]
    report = ("report", "{out}")
    gis = ("exportgis", "{out}", "--output", "{place}/read.zip", "--formats", "csv", "--overwrite")
    add("change", [*clouds[:2], "--cell", "0.5", *into], coarse, report)
    add("demchange", [*models, *into], ["--overwrite", "--minimum-area", "1"], report)
    add("displacement", [*clouds[:2], *into], ["--overwrite", "--spacing", "2.5"], report)
    screen = ["--output", "{out}/a.laz", "--zones", "{other}/zones.gpkg", "--screening-method", "filter"]
    add("screen", [clouds[1], *screen], ["--any-relief"], gis)
    add("register", [*clouds[:2], "--output", "{out}/a.laz", "--transform", "{other}/transform.json"], [])
    add("ground", [clouds[0], "--output", "{out}/a.laz"], ["--profile", "paper"])
    add("exportgis", [str(place / "change"), "--output", "{out}"], ["--overwrite", "--formats", "csv"])
    add("series", [*epochs, "--ground-ready", "--cell", "0.5", *into], coarse, report)
    add("inspect", [*epochs[:2], "--screening-method", "filter", "--cell", "0.5", *into], coarse, report)
    return found


def elevation_model(path: Path, sunk: float, seed: int) -> Path:
    from slopewatch.tests.builders.elevation_models import hills, noise, write_model

    heights = hills(120, 120) + noise((120, 120), 0.03, 4.0, seed)
    heights[40:60, 40:60] -= sunk
    return Path(write_model(path, heights))


# the folders


def tree(folders: list[str]) -> Tree:
    """All files of the folders by their names, but the report, which reading commands draw again."""
    found: Tree = {}
    for number, folder in enumerate(map(Path, folders)):
        for path in sorted(folder.rglob("*")):
            name = f"{number}/{path.relative_to(folder)}"
            if path.is_symlink():
                found[name] = os.readlink(path).encode()
            elif path.is_file() and path.name != "report.html":
                found[name] = path.read_bytes()
    return found


def copied(folders: list[str], target: Path) -> None:
    for number, folder in enumerate(folders):
        shutil.copytree(folder, target / str(number), symlinks=True)


def restored(folders: list[str], source: Path) -> None:
    for number, folder in enumerate(folders):
        shutil.rmtree(folder)
        shutil.copytree(source / str(number), folder, symlinks=True)


def review(folders: list[str]) -> int:
    """Enter a review for the first zone of each table; how many."""
    count = 0
    for table in tables(folders):
        with contextlib.closing(sqlite3.connect(table)) as database, database:
            for name in ("ST_IsEmpty", "ST_MinX", "ST_MaxX", "ST_MinY", "ST_MaxY"):
                database.create_function(name, 1, lambda _: None)
            done = database.execute(
                "UPDATE zones SET review_status = 'confirmed', remarks = ? WHERE fid = (SELECT min(fid) FROM zones)",
                (REMARK,),
            )
            count += done.rowcount
    return count


def reviews(folders: list[str]) -> int:
    query = "SELECT count(*) FROM zones WHERE review_status = 'confirmed' AND remarks = ?"
    count = 0
    for table in tables(folders):
        with contextlib.closing(sqlite3.connect(f"{table.as_uri()}?mode=ro", uri=True)) as database:
            count += database.execute(query, (REMARK,)).fetchone()[0]
    return count


def tables(folders: list[str]) -> Iterator[Path]:
    return (path for folder in folders for name in TABLES if (path := Path(folder) / name).is_file())


# the process that is killed


class Forks:
    """Stands in for ``os.replace`` of a run, and forks the run once its journal is about to get its name.

    Args:
        kept: folder for copies.
        count: reviews that must be there after each kill.
    """

    def __init__(self, case: Case, kept: Path, count: int) -> None:
        self.case, self.kept, self.count = case, kept, count
        self.old, self.new = tree(case.folders), Tree()
        self.faults: list[str] = []
        self.early = self.kills = self.last_old = 0
        self._replace = os.replace
        self._one = threading.Lock()

    def replace(self, source: Any, target: Any) -> None:
        if os.path.basename(target) != ".journal":
            with self._one:
                self._look_before_the_journal()
            self._replace(source, target)
        elif self._forks(source, target):
            os.replace(source, target)  # in a fork, which goes on
        else:
            counts = {"early": self.early, "kills": self.kills, "old": self.last_old}
            print(json.dumps({"faults": self.faults, **counts}), flush=True)
            os._exit(0)

    def _look_before_the_journal(self) -> None:
        from slopewatch.engine.core.part_folders import settle

        with contextlib.suppress(shutil.Error):  # other threads write new files meanwhile
            copied(self.case.folders, self.kept / "early")
        copies = [str(self.kept / "early" / str(n)) for n in range(len(self.case.folders))]
        for copy in copies:
            settle(Path(copy))
        if tree(copies) != self.old:
            self.faults.append(f"before move {self.early} of the run itself: the folders are not as they were")
        shutil.rmtree(self.kept / "early")
        self.early += 1

    def _forks(self, source: str, target: str) -> bool:
        """True in a fork that is to go on; False in the run itself, when all is tried."""
        os.replace = self._replace
        unlock()
        copied(self.case.folders, self.kept / "begun")
        number = 0  # is not killed, so that the new results are known
        while not self.faults or number == 0:
            if forked():
                kill_before(number)
                return True
            if ended() == 0:
                if number:
                    break
                self.new = tree(self.case.folders)
            elif self._look(f"killed before move {number}", number) == self.old:
                self.last_old = number
            restored(self.case.folders, self.kept / "begun")
            number += 1
        self.kills = number - 1
        if self.old == self.new:
            self.faults.append("the second run gives the same results, so that nothing was tried")
        restored(self.case.folders, self.kept / "begun")
        if forked():
            kill_before(self.last_old)
            return True
        ended()
        self._kill_what_puts_back()
        return False

    def _kill_what_puts_back(self) -> None:
        copied(self.case.folders, self.kept / "half")
        number = 1
        while self._command(["report", self.case.folders[-number % len(self.case.folders)]], number) == -signal.SIGKILL:
            self._look(f"killed before move {number} of putting back", number)
            restored(self.case.folders, self.kept / "half")
            number += 1
        self.kills += number - 1

    def _look(self, what: str, number: int) -> Tree:
        """What the folders hold after the next command."""
        first, *others = sorted(self.case.folders, reverse=number % 2 == 0)
        self._command(self.case.next_command(first, number))
        for folder in others:
            self._command(["report", folder])
        left = tree(self.case.folders)
        if left not in (self.old, self.new):
            names = sorted(n for n in self.old.keys() | left.keys() if self.old.get(n) != left.get(n))
            self.faults.append(f"{what}: neither the old results nor the new ones: {names[:8]}")
        elif reviews(self.case.folders) != self.count:
            self.faults.append(f"{what}: {reviews(self.case.folders)} of {self.count} reviews")
        return left

    def _command(self, words: list[str], kill_at: int = 0) -> int:
        """Exit code of a command in a fork."""
        if not forked():
            return ended()
        from slopewatch.cli.program import cli
        from slopewatch.engine.core import part_folders

        part_folders._of_this_process.clear()
        for stream in (1, 2):
            os.dup2(os.open(os.devnull, os.O_WRONLY), stream)
        code = 1
        try:
            kill_before(kill_at)
            cli.main(args=[*words, "--progress", "none"])
        except SystemExit as end:
            code = end.code if isinstance(end.code, int) else 1
        finally:
            os._exit(code)


def forked() -> bool:
    """Whether this is the fork; the other process waits with ``ended``."""
    sys.stdout.flush()
    return os.fork() == 0


def ended() -> int:
    return os.waitstatus_to_exitcode(os.wait()[1])


def unlock() -> None:
    """Give back the locks of part folders, which forks would share and so hold when they are dead."""
    for entry in Path("/proc/self/fd").iterdir():
        with contextlib.suppress(OSError):
            if os.readlink(entry).endswith("/.owner"):
                fcntl.flock(int(entry.name), fcntl.LOCK_UN)


def kill_before(number: int) -> None:
    """End this process by SIGKILL before its rename or removal of that number; 0: never."""
    calls = 0

    def counted(call: Callable[..., None]) -> Callable[..., None]:
        def move(*arguments: Any, **more: Any) -> None:
            nonlocal calls
            calls += 1
            if calls == number:
                os.kill(os.getpid(), signal.SIGKILL)
            call(*arguments, **more)

        return move

    for name in CALLS:
        setattr(os, name, counted(getattr(os, name)))


def within(case: Case, kept: Path, count: int) -> None:
    """In a process of its own: the second run of a command, which forks itself."""
    from slopewatch.cli.program import cli

    os.fsync = lambda _: None  # a killed process does not need it, and it takes most of the time
    os.replace = Forks(case, kept, count).replace
    cli.main(args=[*case.words, *case.again, "--progress", "none"])


# all commands


def tried(name: str, case: Case, place: Path) -> list[str]:
    began = time.monotonic()
    for folder in case.folders:
        Path(folder).mkdir()
    first = [sys.executable, "-m", "slopewatch.cli", *case.words, "--progress", "none"]
    made = subprocess.run(first, capture_output=True, text=True, check=False)
    if made.returncode:
        return [f"the first run ended with {made.returncode}: {made.stderr[-300:]}"]
    entered = review(case.folders)
    with tempfile.TemporaryDirectory(dir=place) as kept:
        given = json.dumps({"case": asdict(case), "kept": kept, "count": entered})
        run = subprocess.run([sys.executable, __file__, "--within", given], capture_output=True, text=True, check=False)
    try:
        told = json.loads(run.stdout.splitlines()[-1])
    except (IndexError, ValueError):
        return [f"the second run ended with {run.returncode}: {run.stderr[-600:]}"]
    print(
        f"{name}: {told['kills']} kills, {told['old']} before the results were new; {told['early']} moves before the "
        f"journal; {entered} reviews; {len(told['faults'])} faults; {time.monotonic() - began:.0f} s",
        flush=True,
    )
    return list(told["faults"])


def main() -> int:
    parser = argparse.ArgumentParser(description="Kill commands at every rename and look at what the next one finds.")
    parser.add_argument("commands", nargs="*", help="all by default; exportgis needs change before it")
    parser.add_argument("--within", help=argparse.SUPPRESS)
    given = parser.parse_args()
    runpy.run_path(str(ROOT / "tests" / "conftest.py"))
    if given.within:
        told = json.loads(given.within)
        within(Case(**told["case"]), Path(told["kept"]), told["count"])
    found = 0
    with tempfile.TemporaryDirectory(prefix="kills-") as name:
        for command, case in cases(Path(name)).items():
            if not given.commands or command in given.commands:
                for fault in tried(command, case, Path(name)):
                    print(f"  {command}: {fault}", flush=True)
                    found += 1
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
