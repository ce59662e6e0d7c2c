"""A corridor of small simulated slopes: workers, the engine's overhead, killed workers, a run again, and Dask.

Run with another number of slopes by ``python -c "from slopewatch.lab.benchmarks.corridor import main; main(200)"``.
"""

from __future__ import annotations

import hashlib
import importlib.util
import json
import os
import random
import resource
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ...interface.parameters import SurveyParameters
from ...simulation.surveys.series import Creep, simulate_series, survey_days, write_series
from .table import Row, heading, markdown, say

_SLOPES, _SURVEYS, _KILL_EVERY_S = 12, 3, 30.0
_SMALL: dict[str, Any] = {"points": 12_000, "length": 14.0, "height": 6.0, "vegetation": 0.2, "offset": 0.05}
_COMPARED = (".tif", ".gpkg", ".csv", ".vpc", ".html", ".vrt")
_OWN_TIMES = ("report.html", "run.json")  # they hold the moment and the seconds of their run


@dataclass(frozen=True)
class Timed:
    """One run of the batch: clock and processor seconds, its states, its warnings, and a hash of each result."""

    clock: float
    processor: float
    states: dict[str, dict[str, object]]
    computed: int
    hashes: dict[str, str]

    @property
    def tasks(self) -> float:
        """Clock seconds of all slopes together."""
        return sum(float(str(state["seconds"])) for state in self.states.values())


def rows(count: int = _SLOPES) -> list[Row]:
    """Clock and processor seconds of each way to work on ``count`` slopes, and whether the results are equal."""
    with tempfile.TemporaryDirectory(prefix="slopewatch-corridor-") as name:
        folder = Path(name)
        manifest = _manifest(folder, count)
        say(f"{count} slopes were simulated; load {os.getloadavg()[0]:.1f}")
        one = _timed(manifest, folder / "one", "--workers=1")
        again = _timed(manifest, folder / "one", "--workers=1")
        two = _timed(manifest, folder / "two", "--workers=2")
        kills: list[float] = []
        killed = _timed(manifest, folder / "killed", "--workers=2", meanwhile=lambda pid: _kill(pid, kills))
        found = _rows(count, one, two, again, killed, len(kills))
        if importlib.util.find_spec("distributed") is not None:
            dask = _timed(manifest, folder / "dask", "--workers=2", "--scheduler=local")
            found.append(Row("Dask, 2 worker processes", _seconds(dask), "", f"equal results: {_equal(one, dask)}"))
        return found


def _rows(count: int, one: Timed, two: Timed, again: Timed, killed: Timed, kills: int) -> list[Row]:
    share = two.clock / one.clock
    overhead = (one.clock - one.tasks) / one.tasks
    done = sum(state["state"] == "done" for state in killed.states.values())
    more = sum(int(str(state["attempts"])) for state in killed.states.values()) - count
    return [
        Row(f"{count} slopes x {_SURVEYS} surveys, 1 worker", _seconds(one), "", f"load {os.getloadavg()[0]:.1f}"),
        Row("2 workers", _seconds(two), "", f"equal results: {_equal(one, two)}"),
        Row("clock of 2 workers over that of 1", f"{share:.2f}", "0.6", "", share <= 0.6),
        Row(
            "overhead of the engine next to the slopes, 1 worker",
            f"{100 * overhead:.1f} %",
            "< 10 %",
            "",
            overhead < 0.1,
        ),
        Row(
            f"a slope's process killed every {_KILL_EVERY_S:.0f} s ({kills} kills), slopes done",
            f"{done} of {count}",
            f"{count}",
            f"{more} tries more; {_seconds(killed)}; equal results: {_equal(one, killed)}",
            done == count,
        ),
        Row(
            "run again, nothing changed",
            _seconds(again),
            "< 10 s",
            f"{again.computed} slopes computed",
            again.clock < 10 and again.computed == 0,
        ),
    ]


def _manifest(folder: Path, count: int) -> Path:
    """Simulate the slopes and write their manifest."""
    lines = ["slope,date,file,roi"]
    for number in range(count):
        name = f"S{number + 1:03d}"
        series = simulate_series(
            SurveyParameters(seed=number + 1, **_SMALL),
            survey_days(_SURVEYS, 30),
            (Creep(-0.002 * (1 + number % 4), 15.0),) if number % 3 else (),
            half_axes=(1.8, 1.4),
        )
        place = folder / name
        place.mkdir()
        written = write_series(series, place, ground_only=False)
        days = [day for day in written if day[:4].isdigit()]
        lines += [f"{name},{day},{name}/{written[day].name},{name}/{written['roi'].name}" for day in days]
    path = folder / "corridor.csv"
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def _timed(
    manifest: Path, folder: Path, *options: str, meanwhile: Callable[[int], threading.Event] | None = None
) -> Timed:
    """Run the batch as a user does; ``meanwhile`` is given its process number, and its event is set at the end."""
    command = [sys.executable, "-m", "slopewatch.cli", "batch", str(manifest), f"--output-dir={folder}", *options]
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    started = time.monotonic()
    with subprocess.Popen(
        [*command, "--retries=20", "--progress=json"], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True
    ) as batch:
        ended = meanwhile(batch.pid) if meanwhile is not None else None
        said = batch.stdout.read() if batch.stdout is not None else ""
    clock = time.monotonic() - started
    if ended is not None:
        ended.set()
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    result = json.loads(said.splitlines()[-1])
    if batch.returncode != 0 or result.get("event") != "result":
        raise RuntimeError(f"the batch ended with {batch.returncode}: {result}")
    processor = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    lines = (folder / "slopes.jsonl").read_text(encoding="utf-8").splitlines()
    states = {state["slope"]: state for state in map(json.loads, filter(None, lines))}
    say(f"{' '.join(options)}: {clock:.0f} s, load {os.getloadavg()[0]:.1f}")
    return Timed(clock, processor, states, int(result["metrics"]["slopes_computed"]), _hashes(folder))


def _hashes(folder: Path) -> dict[str, str]:
    files = sorted(p for p in folder.rglob("*") if p.suffix in _COMPARED and p.name not in _OWN_TIMES)
    return {str(p.relative_to(folder)): hashlib.sha256(p.read_bytes()).hexdigest() for p in files}


def _equal(first: Timed, other: Timed) -> str:
    names = first.hashes.keys() | other.hashes.keys()
    same = sum(first.hashes.get(name) == other.hashes.get(name) for name in names)
    return f"{same} of {len(names)} files"


def _kill(batch: int, kills: list[float]) -> threading.Event:
    """Kill one of the processes that work on slopes every 30 s until the event is set."""
    ended, chance = threading.Event(), random.Random(1)

    def work() -> None:
        while not ended.wait(_KILL_EVERY_S):
            victims = [pid for pid in _children(batch) if b"--output-dir" in _command(pid)]
            if victims:
                os.kill(chance.choice(victims), signal.SIGKILL)
                kills.append(time.monotonic())

    threading.Thread(target=work, daemon=True).start()
    return ended


def _children(parent: int) -> Sequence[int]:
    found = []
    for status in Path("/proc").glob("[0-9]*/stat"):
        try:
            fields = status.read_text().rpartition(")")[2].split()
        except OSError:  # it has ended
            continue
        if int(fields[1]) == parent:
            found.append(int(status.parent.name))
    return found


def _command(pid: int) -> bytes:
    try:
        return Path(f"/proc/{pid}/cmdline").read_bytes()
    except OSError:
        return b""


def _seconds(run: Timed) -> str:
    return f"{run.clock:.1f} s clock, {run.processor:.1f} s processor"


def main(count: int) -> None:
    """Print the table for so many slopes."""
    print(heading(), flush=True)
    print(markdown("A corridor of slopes", rows(count)), flush=True)
