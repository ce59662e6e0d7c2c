"""The whole flow on two raw clouds of a million points, compared with two CSF runs at the published settings."""

from __future__ import annotations

import json
import tempfile
import time
from pathlib import Path

import numpy as np
import rasterio

from ...engine.grid.grid import Grid
from ...engine.ground.cloth import cloth_ground
from ...engine.statistics.robust import nmad
from ...interface.parameters import GroundParameters, SurveyParameters
from ...simulation.surveys.survey import SimulatedPair, simulate_pair
from ...simulation.surveys.write import write_pair
from .chain import inside
from .table import Row
from .watched import inspect_command, run_watched

POINTS = 1_000_000


def rows() -> list[Row]:
    """Seconds, their ratio to the filter alone, memory, and the accuracy on the way."""
    pair = simulate_pair(SurveyParameters(points=POINTS))
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        paths = write_pair(pair, folder, compressed=False)
        clouds = [cloud.xyz[inside(cloud.xyz, pair)] for cloud in (pair.first, pair.second)]
        paper = GroundParameters.build(profile="paper")
        start = time.perf_counter()
        for xyz in clouds:
            cloth_ground(xyz, paper)
        filter_seconds = time.perf_counter() - start
        seconds, peak = _inspect(folder, paths)
        record = json.loads((folder / "out" / "run.json").read_text())
        metrics = record["metrics"]
        report = next(stage["seconds"] for stage in record["stages"] if stage["stage"] == "report")
        error = _change_error(folder, pair)
    raw = ", ".join(f"{len(c.xyz) / 1e6:.2f} M" for c in (pair.first, pair.second))
    clipped = ", ".join(f"{len(c) / 1e6:.2f} M" for c in clouds)
    ratio = seconds / filter_seconds
    return [
        Row(
            f"inspect without screening, two raw clouds ({raw}; in the ROI {clipped})",
            f"{seconds:.1f} s = {ratio:.2f} x",
            "at most 1.5 x",
            f"two CSF runs at the published settings {filter_seconds:.1f} s",
            ratio <= 1.5,
        ),
        Row("inspect, peak memory of all its processes", f"{peak / 1e9:.2f} GB", "at most 2 GB", "", peak <= 2e9),
        Row("its report", f"{report:.1f} s", "at most 10 s", "", report <= 10),
        Row(
            "common cells of 0.1 m, simulated pair; compared by cells that grow from them",
            f"{100 * metrics['common_cell_rate']:.2f} %; {100 * metrics['compared_share']:.1f} % of the ground",
            "",
            "published 94.71 % common cells (another site)",
        ),
        Row(
            "dz against the truth, all that was compared",
            f"median error {error[0] * 1000:+.1f} mm, NMAD {error[1] * 1000:.1f} mm",
        ),
    ]


def _inspect(folder: Path, paths: dict[str, Path]) -> tuple[float, int]:
    # Screening is measured by its own benchmark.
    return run_watched([*inspect_command(paths, folder / "out"), "--no-screen-last-epoch", "--adaptive"])


def _change_error(folder: Path, pair: SimulatedPair) -> tuple[float, float]:
    with rasterio.open(folder / "out" / "elevation_change.tif") as raster:
        dz = raster.read(1, masked=True).filled(np.nan)
        west, north, cell = raster.transform.c, raster.transform.f, raster.transform.a
    truth = pair.true_change_raster(Grid(west, north, cell, *dz.shape))
    error = (dz - truth)[np.isfinite(dz)]
    median = float(np.median(error))
    return median, nmad(error, median)
