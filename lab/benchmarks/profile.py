"""Where the processor time of ``inspect``, ``series`` and ``screen`` goes, stage by stage, on simulated surveys.

Seconds are those that processors worked for the command and its children, which other programs on the machine change
little. Of each stage the least of ``RUNS`` runs counts. What no stage of the run record holds is starting Python, its
imports, the checks of the inputs and what is written between the stages.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from ...interface.parameters import SurveyParameters
from ...simulation.surveys.series import Creep, simulate_series, survey_days, write_series
from ...simulation.surveys.survey import simulate_pair
from ...simulation.surveys.write import write_pair
from .table import Row, say
from .watched import inspect_command

RUNS = 3
SERIES_SURVEYS, SERIES_POINTS = 6, 300_000
_DAYS_APART, _CREEP_M_A_DAY = 30, -0.002
REST = "start-up, imports and checks"


def rows() -> list[Row]:
    """A row a stage of each command, in the order of the run, and one of the whole."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        pair = write_pair(simulate_pair(SurveyParameters()), folder / "pair")
        size = SurveyParameters(points=SERIES_POINTS, length=30.0, height=14.0)
        series = simulate_series(size, survey_days(SERIES_SURVEYS, _DAYS_APART), (Creep(_CREEP_M_A_DAY),))
        write_series(series, folder / "series")
        found = profiled("inspect", lambda out: inspect_command(pair, out), folder / "inspect", "run.json")
        found += profiled(
            f"series of {SERIES_SURVEYS} surveys",
            lambda out: ["series", str(folder / "series"), "--output-dir", str(out)],
            folder / "out",
            "run.json",
        )
        ground = folder / "inspect" / "0" / "clouds" / f"{pair['second'].stem}_ground.laz"
        found += profiled(
            "screen",
            lambda out: ["screen", str(ground), "--output", str(out / "screened.laz")],
            folder / "screened",
            "screened_run.json",
        )
    return found


def profiled(name: str, arguments: Callable[[Path], Sequence[str]], folder: Path, record: str) -> list[Row]:
    """The rows of one command, run ``RUNS`` times.

    Each run has an empty folder of its own within ``folder``: a series goes on with what it finds.

    Args:
        arguments: those of the command that writes into a folder.
        record: name of the run record that it writes there.
    """
    runs = []
    for number in range(RUNS):
        say(f"{name}, run {number + 1} of {RUNS}")
        out = folder / str(number)
        out.mkdir(parents=True)
        whole = worked(arguments(out))
        runs.append(seconds_of_stages(json.loads((out / record).read_text(encoding="utf-8")), whole))
    return table(name, least(runs))


def worked(arguments: Sequence[str]) -> float:
    """Seconds that processors worked for ``slopewatch ARGUMENTS`` and all its children (POSIX).

    Raises:
        RuntimeError: the command failed.
    """
    before = os.times()
    done = subprocess.run([sys.executable, "-m", "slopewatch.cli", *arguments], capture_output=True, check=False)
    if done.returncode:
        raise RuntimeError(done.stderr.decode(errors="replace"))
    after = os.times()
    return after.children_user + after.children_system - before.children_user - before.children_system


def seconds_of_stages(record: Mapping[str, Any], whole: float) -> dict[str, float]:
    """Processor seconds of a run record's stages by name, those of one name together, and of the ``REST``."""
    found: dict[str, float] = {}
    for stage in record["stages"]:
        found[stage["stage"]] = found.get(stage["stage"], 0.0) + stage["processor_seconds"]
    return found | {REST: max(whole - sum(found.values()), 0.0)}


def least(runs: Sequence[Mapping[str, float]]) -> dict[str, float]:
    """The least seconds of each stage among runs that all have it, in the order of the first."""
    return {name: min(run[name] for run in runs) for name in runs[0]}


def table(name: str, stages: Mapping[str, float]) -> list[Row]:
    """A row a stage with its share, the whole last."""
    whole = sum(stages.values())
    shares = [
        Row(f"{name}: {stage}", f"{seconds:.2f} s ({100 * seconds / max(whole, 1e-9):.0f} %)")
        for stage, seconds in stages.items()
    ]
    return [*shares, Row(f"{name}: whole", f"{whole:.2f} s")]
