"""How processor time and memory grow with a slope: ``python -m slopewatch.lab growth --results FOLDER``.

Simulated slopes of 1 to 100 million points a survey go through ``ground``, ``register`` and ``change``, each command as
a process of its own. What was measured is kept in FOLDER/growth.jsonl, so that a run that is stopped goes on where it
stopped; FOLDER/growth.md and FOLDER/growth.png are made from it. What would take longer than ``--minutes`` is not
started, and said so.
"""

from __future__ import annotations

import argparse
import shutil
import subprocess
import sys
import time
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from datetime import date
from pathlib import Path

import numpy as np
import rasterio
from pyproj import CRS

from ...engine.core.version import VERSION
from ...engine.geometry.rigid_transform import RigidTransform
from ...simulation.surveys.survey import CRS as SYSTEM
from .growth_law import LEAST_SIZES, Law, fitted
from .growth_report import Series, draw, report
from .growth_store import Key, Measured, append, read
from .long_slopes import DATES, LENGTH_M, OFFSET_M, RUN_M, frame_of, write_long, write_long_region, write_piece
from .measured_child import alone, measured
from .table import heading, machine, say

MILLIONS = (1.0, 3.0, 10.0, 30.0, 100.0)
STAGES = ("ground", "register", "change")
MEMORY_GB = 4.0
"""What the commands are told to hold to, where they can be told."""
KILL_GB = 8.0
"""A command that holds more is ended, so that the machine does not fall over."""
WORST_EXPONENT = 1.05


def main(arguments: Sequence[str]) -> int:
    """Measure what is missing, then write table and plot; 1 if time grows faster than WORST_EXPONENT."""
    parser = argparse.ArgumentParser(prog="python -m slopewatch.lab growth", description=__doc__)
    parser.add_argument("--results", type=Path, required=True, metavar="FOLDER", help="kept, to go on from")
    parser.add_argument("--minutes", type=float, default=600.0, help="by the clock, for all (default 600)")
    parser.add_argument("--sizes", type=float, nargs="+", default=MILLIONS, metavar="N", help="million points a survey")
    parser.add_argument("--stages", nargs="+", choices=STAGES, default=STAGES)
    parser.add_argument("--azimuth", type=float, default=180.0, help="the way the slope faces (180: along the axes)")
    options = parser.parse_args(arguments)
    folder = options.results.absolute()
    folder.mkdir(parents=True, exist_ok=True)
    deadline = time.monotonic() + 60 * options.minutes
    known = read(folder / "growth.jsonl")
    for millions in sorted(options.sizes):
        for stage in options.stages:
            key = (millions, stage, options.azimuth)
            if key in known and known[key].final:
                continue
            row = measure(key, folder / "clouds", known, deadline)
            known[key] = row
            append(folder / "growth.jsonl", row)
            say(f"{stage}, {millions:g} million: {row.reason or f'{row.cpu:.0f} s, {row.together / 1e9:.2f} GB'}")
            shutil.rmtree(_place(folder / "clouds", options.azimuth, millions), ignore_errors=True)
    laws = write_results(folder, [row for row in known.values() if row.azimuth == options.azimuth])
    return int(any(law.exponent > WORST_EXPONENT for law in laws.values()))


def write_results(folder: Path, rows: Sequence[Measured]) -> dict[str, Law]:
    """Write growth.md and growth.png and print the table; the laws of the processor time."""
    series, alike = series_of(rows), series_of(of_one_cell(rows))
    laws, memory = laws_of(alike, 1), laws_of(alike, 2)
    text = heading() + "\n" + report(rows, laws, memory)
    (folder / "growth.md").write_text(text, encoding="utf-8")
    draw(folder / "growth.png", series, laws, memory)
    print(text)
    return laws


def expected_s(key: Key, known: Iterable[Measured]) -> float | None:
    """Seconds by the clock that a size should take: in proportion to the largest one measured; None before any."""
    millions, stage, azimuth = key
    before = [r for r in known if r.stage == stage and r.azimuth == azimuth and not r.reason]
    largest = max(before, key=lambda row: row.millions, default=None)
    return None if largest is None else largest.seconds * millions / largest.millions


def measure(key: Key, clouds: Path, known: Mapping[Key, Measured], deadline: float) -> Measured:
    """Measure one command on one size, if there is time for it."""
    millions, stage, azimuth = key
    stamp = Measured(*key, day=date.today().isoformat(), machine=machine(), code=state())
    needed, left = expected_s(key, known.values()), deadline - time.monotonic()
    if left <= 0 or (needed is not None and needed > left):
        takes = "" if needed is None else f": it would take some {max(needed / 60, 1):.0f} minutes by the clock"
        return replace(stamp, reason=f"not run{takes}")
    command, points = _prepared(key, clouds)
    left = max(deadline - time.monotonic(), 1.0)
    spent = measured(command, environment=alone(), limit_bytes=KILL_GB * 1e9, limit_s=left)
    error = cell = None
    if stage == "register" and not spent.reason:
        found = RigidTransform.load(_place(clouds, azimuth, millions) / "transform.json")
        error = registration_mm(found, millions, azimuth)
    if stage == "change" and not spent.reason:
        with rasterio.open(_place(clouds, azimuth, millions) / "change" / "elevation_change.tif") as raster:
            cell = float(raster.res[0])
    return replace(
        stamp,
        points=points,
        cpu=spent.cpu,
        seconds=spent.seconds,
        peak=spent.peak,
        together=spent.together,
        error_mm=error,
        cell_m=cell,
        reason=spent.reason,
    )


def state() -> str:
    """The program's version and, in a checkout, the last commit of what is measured."""
    root = Path(__file__).resolve().parents[2]
    words = ["git", "-C", str(root), "log", "-1", "--format=%h", "--", "engine", "interface", "workflows", "cli"]
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    return f"{VERSION} {done.stdout.strip()}".strip()


def _prepared(key: Key, clouds: Path) -> tuple[list[str], int]:
    """The command of a stage, and how many points it reads; its clouds are written into a new folder."""
    millions, stage, azimuth = key
    piece, place, frame = _piece(clouds, azimuth), _place(clouds, azimuth, millions), frame_of(azimuth)
    shutil.rmtree(place, ignore_errors=True)
    place.mkdir(parents=True)
    program = [sys.executable, "-m", "slopewatch.cli", stage]
    if stage == "ground":
        raw, roi = place / f"raw_{DATES[0]}.laz", place / "roi.gpkg"
        write_long_region(roi, millions, frame)
        points = write_long(piece / f"{DATES[0]}.laz", raw, millions, frame, moved=False)
        options = ["--roi", roi, "--output", place / "ground.laz", "--ground-memory", MEMORY_GB]
        return [*program, str(raw), *map(str, options)], points
    paths = [place / f"{day}.laz" for day in DATES]
    grounds = [piece / f"ground_{day}.laz" for day in DATES]
    points = sum(
        write_long(ground, path, millions, frame, moved=number == 1)
        for number, (ground, path) in enumerate(zip(grounds, paths, strict=True))
    )
    transform = place / "transform.json"
    if stage == "register":
        options = ["--output", place / "registered.laz", "--transform", transform]
    else:
        # the true motion, so that the change does not wait for a registration
        RigidTransform(np.eye(3), OFFSET_M, np.zeros(3)).save(transform, CRS.from_user_input(SYSTEM))
        # the cell is left to the clouds, so that it becomes the next one that fits where 0.1 m needs too much memory
        options = ["--transform", transform, "--output-dir", place / "change", "--memory-limit", MEMORY_GB]
    return [*program, *map(str, paths), *map(str, options)], points


def _piece(clouds: Path, azimuth: float) -> Path:
    """The folder of the piece: its two surveys and their ground, made once."""
    folder = clouds / f"{azimuth:g}" / "piece"
    if (folder / "ready").exists():
        return folder
    shutil.rmtree(folder, ignore_errors=True)
    write_piece(folder, azimuth)
    for day in DATES:
        say(f"ground of the piece, {day}")
        words: list[str | Path] = [
            folder / f"{day}.laz",
            "--roi",
            folder / "roi.gpkg",
            "--output",
            folder / f"ground_{day}.laz",
        ]
        spent = measured([sys.executable, "-m", "slopewatch.cli", "ground", *words], environment=alone())
        if spent.reason:
            raise RuntimeError(f"the ground of the piece {spent.reason}")
    (folder / "ready").touch()
    return folder


def _place(clouds: Path, azimuth: float, millions: float) -> Path:
    return clouds / f"{azimuth:g}" / f"{millions:g}"


def registration_mm(transform: RigidTransform, millions: float, azimuth: float) -> float:
    """Root mean square error of a motion over ends, toe and crest of the slope, mm."""
    places = [(u, v, 0.8 * v) for u in np.linspace(0, millions * LENGTH_M, 11) for v in (0.0, RUN_M)]
    at = frame_of(azimuth).to_world(np.array(places))
    return 1000 * float(np.sqrt(np.mean(np.sum((transform.apply(at - OFFSET_M) - at) ** 2, axis=1))))


def laws_of(series: Series, column: int) -> dict[str, Law]:
    """Power laws by stage of column 1 (processor time) or 2 (memory), of stages measured at enough sizes."""
    return {
        stage: fitted([line[0] for line in lines], [line[column] for line in lines])
        for stage, lines in series.items()
        if len(lines) >= LEAST_SIZES
    }


def of_one_cell(rows: Sequence[Measured]) -> list[Measured]:
    """Without changes whose cells had to be larger than those of the smallest slope."""
    cells = [(row.millions, row.cell_m) for row in rows if row.cell_m is not None]
    return [row for row in rows if row.cell_m is None or row.cell_m == min(cells)[1]]


def series_of(rows: Iterable[Measured]) -> Series:
    """By stage, size by size: points read, seconds of the processor, bytes of all processes."""
    series: dict[str, list[tuple[float, float, float]]] = {}
    for row in sorted(rows, key=lambda row: row.millions):
        if not row.reason:
            series.setdefault(row.stage, []).append((row.points, row.cpu, row.together))
    return series
