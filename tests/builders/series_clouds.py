"""A simulated series with its runs, and small dated planes."""

from __future__ import annotations

import json
from dataclasses import replace
from datetime import date
from pathlib import Path

import geopandas
import laspy
import numpy as np
import pytest
from pyproj import CRS
from slopewatch.engine.epochs.epoch import Epoch
from slopewatch.engine.pointcloud.plant_cover import ERROR, HEIGHT
from slopewatch.interface.parameters import (
    ChangeParameters,
    DisplacementStepParameters,
    GridChangeParameters,
    RegistrationParameters,
    SeriesParameters,
    SurveyParameters,
)
from slopewatch.simulation.surveys.series import Creep, Settling, simulate_series, survey_days, write_series
from slopewatch.workflows import series_preparation
from slopewatch.workflows.series import monitor_series
from slopewatch.workflows.settings import SeriesSettings

READY = SeriesSettings(series=SeriesParameters(ground_ready=True), change=GridChangeParameters(cell=0.25))


STEPS = ("extract_ground", "register_pair", "epoch_cells", "epoch_moments")


@pytest.fixture(scope="session")
def simulated(tmp_path_factory):
    parameters = SurveyParameters(seed=3, points=26_000, length=20.0, height=7.0, vegetation=0.2, offset=0.05)
    laws = (Creep(-0.01, 15.0), Creep(0.004), Settling(-0.5, 40.0))
    series = simulate_series(parameters, survey_days(5, 30), laws, half_axes=(1.8, 1.4))
    return series, write_series(series, tmp_path_factory.mktemp("series"), ground_only=True)


def surveys(paths) -> list[Epoch]:
    days = [name for name in paths if name[:4].isdigit()]
    return [Epoch(paths[day], date.fromisoformat(day)) for day in days]


class Counted:
    """Which steps ran, in the order of their calls."""

    def __init__(self, patch: pytest.MonkeyPatch) -> None:
        self.calls: list[str] = []
        for name in STEPS:
            patch.setattr(series_preparation, name, self._counting(name, getattr(series_preparation, name)))

    def _counting(self, name, function):
        def run(*arguments, **options):
            self.calls.append(name)
            return function(*arguments, **options)

        return run


@pytest.fixture(scope="session")
def runs(simulated, tmp_path_factory):
    """The first four surveys, then all five into the same folder."""
    _, paths = simulated
    out = tmp_path_factory.mktemp("out") / "of the slope"
    found = []
    for count in (4, 5):
        with pytest.MonkeyPatch.context() as patch:
            counted = Counted(patch)
            done = monitor_series(surveys(paths)[:count], out, READY, roi=paths["roi"])
            outputs, metrics = done.outputs, done.figures
        record = json.loads((out / "run.json").read_text())
        zones = geopandas.read_file(out / "series.gpkg", layer="zones")
        found.append((counted.calls, record, zones, outputs, metrics))
    return out, found


def plane(
    path: Path,
    *,
    raised: float = 0.0,
    crs: int = 32651,
    x: float = 0.0,
    bump: float = 0.0,
    seed: int = 0,
    points: int = 12_000,
    grass: float | None = None,
) -> Path:
    """A slope of 10 by 10 m; all of it raised, or a square of 3 m in it by ``bump``.

    Args:
        grass: height (m) of the vegetation on the eastern 8 m, which lifts the ground found there by a quarter of it;
            None: the cloud does not state its vegetation.
    """
    rng = np.random.default_rng(seed)
    u, v = rng.uniform(0, 10, (2, points))
    square = (np.abs(u - 5) < 1.5) & (np.abs(v - 5) < 1.5)
    height = np.where(u > 2, grass or 0.0, 0.0)
    z = 50 + 0.5 * v + rng.normal(0, 0.01, u.size) + raised + np.where(square, bump, 0) + 0.25 * height
    header = laspy.LasHeader(point_format=6, version="1.4")
    header.scales, header.offsets = [0.001] * 3, [500_000, 3_500_000, 0]
    header.add_crs(CRS.from_epsg(crs))
    if grass is not None:
        header.add_extra_dims([laspy.ExtraBytesParams(name, "f4") for name in (ERROR, HEIGHT)])
    las = laspy.LasData(header)
    las.x, las.y, las.z = 500_000 + x + u, 3_500_000 + v, z
    las.return_number = las.number_of_returns = np.ones(u.size, dtype=np.uint8)
    if grass is not None:
        las[ERROR], las[HEIGHT] = 0.1 * height, height
    las.write(path)
    return path


FIXED = replace(READY, registration=RegistrationParameters(method="none"))


GROWING = replace(FIXED, change=ChangeParameters(), displacement_step=DisplacementStepParameters(displacement=False))
"""The same in cells that grow, without motion along the surface."""
