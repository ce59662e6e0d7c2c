"""Pairs of small epochs, each step on them, and the sentence with which one is refused."""

from __future__ import annotations

from datetime import date
from pathlib import Path

import geopandas
import laspy
import numpy as np
import pytest
import shapely
from pyproj import CRS
from slopewatch.engine.core.errors import InputError
from slopewatch.engine.core.progress import Progress
from slopewatch.engine.epochs.epoch import Epoch
from slopewatch.interface.parameters import (
    ChangeParameters,
    DistanceParameters,
    GridChangeParameters,
    InputParameters,
    RegistrationParameters,
    ReportParameters,
    SeriesParameters,
)
from slopewatch.workflows.change import change_step
from slopewatch.workflows.inspect import inspect_slope
from slopewatch.workflows.m3c2 import m3c2_step
from slopewatch.workflows.register import register_step
from slopewatch.workflows.series import monitor_series
from slopewatch.workflows.settings import DistanceSettings, SeriesSettings, Settings

X, Y = 500_000.0, 3_500_000.0


SIDE = 12.0


COARSE = ChangeParameters(cell=0.5)


ONE_SIZE = GridChangeParameters(cell=0.5)


AS_SURVEYED = RegistrationParameters(method="none")


def slope(seed: int, points: int = 6000) -> np.ndarray:
    """A slope of 31 degrees with relief, 12 x 12 m."""
    rng = np.random.default_rng(seed)
    u, v = rng.uniform(0, SIDE, (2, points))
    z = 50 + 0.6 * v + 0.3 * np.sin(0.9 * u) + 0.25 * np.sin(1.1 * v + 0.4 * u) + rng.normal(0, 0.01, points)
    return np.column_stack([X + u, Y + v, z])


def write(path: Path, xyz: np.ndarray, crs: object = 32651) -> Path:
    header = laspy.LasHeader(point_format=6, version="1.4")
    header.scales, header.offsets = [0.001] * 3, np.floor(xyz[0])
    header.add_crs(CRS.from_user_input(crs))
    las = laspy.LasData(header)
    las.x, las.y, las.z = xyz.T
    las.return_number = las.number_of_returns = np.ones(len(xyz), dtype=np.uint8)
    las.classification = np.full(len(xyz), 2)
    las.write(path)
    return path


@pytest.fixture
def first(tmp_path) -> Path:
    return write(tmp_path / "2024-05-01.laz", slope(1))


def refused(folder: Path, work, *words: str) -> str:
    """The one sentence with which ``work`` is refused; it holds ``words`` and leaves ``folder`` as it was."""
    before = {p: p.stat().st_mtime_ns for p in folder.rglob("*")}
    with pytest.raises(InputError) as caught:
        work()
    assert caught.value.exit_code == 2
    sentence = str(caught.value)
    assert "\n" not in sentence
    assert sentence.endswith(".")
    for word in words:
        assert word in sentence, sentence
    assert {p: p.stat().st_mtime_ns for p in folder.rglob("*")} == before, "something was left behind"
    return sentence


def register(reference: Path, moving: Path, progress: Progress | None = None, *, inputs=None, **parameters):
    settings = Settings(inputs=inputs or InputParameters(), registration=RegistrationParameters(**parameters))
    folder = reference.parent
    return register_step(
        reference,
        moving,
        folder / "aligned.laz",
        settings,
        transform_path=folder / "transform.json",
        given=None,
        invert=False,
        stable=None,
        progress=progress or Progress(),
    )


def change(reference: Path, moving: Path, progress: Progress | None = None):
    return change_step(
        reference,
        moving,
        reference.parent / "out",
        Settings(change=COARSE, report=ReportParameters(zone_profiles=0)),
        dates=("2024-05-01", "2025-05-01"),
        transform_path=None,
        progress=progress or Progress(),
    )


def m3c2(reference: Path, moving: Path, progress: Progress | None = None, output: Path | None = None):
    return m3c2_step(
        reference,
        moving,
        output or reference.parent / "points.laz",
        DistanceSettings(InputParameters(), DistanceParameters(distance_cell=0.5)),
        raster_dir=None,
        core=None,
        dates=("2024-05-01", "2025-05-01"),
        transform_path=None,
        progress=progress or Progress(),
    )


def series(folder: Path, *clouds: Path, progress: Progress | None = None, **options):
    epochs = [Epoch(path, date(2024 + n, 5, 1)) for n, path in enumerate(clouds)]
    settings = SeriesSettings(series=SeriesParameters(ground_ready=True), change=ONE_SIZE, registration=AS_SURVEYED)
    return monitor_series(epochs, folder / "out", settings, progress=progress, **options)


def inspect(folder: Path, *epochs: Epoch, **options):
    return inspect_slope(epochs, folder / "out", Settings(), **options)


def region(path: Path, geometry: shapely.Geometry, crs: object = 32651) -> Path:
    geopandas.GeoDataFrame(geometry=[geometry], crs=32651).to_crs(crs).to_file(path)
    return path


@pytest.fixture(scope="session")
def risen(tmp_path_factory) -> tuple[Path, list[str]]:
    """The outputs of a change between surveys one of which lies 40 cm higher, and the warnings. It has gaps."""
    folder = tmp_path_factory.mktemp("risen")
    clouds = []
    for seed, lift in ((1, 0.0), (2, 0.4)):
        xyz = slope(seed)
        xyz = xyz[np.hypot(xyz[:, 0] - X - 6, xyz[:, 1] - Y - 6) > 2]
        clouds.append(write(folder / f"202{seed}-05-01.laz", xyz + [0, 0, lift]))
    progress = Progress()
    change(*clouds, progress)
    m3c2(*clouds, output=folder / "out" / "points.laz")
    return folder / "out", progress.warnings


@pytest.fixture(scope="session")
def watched(tmp_path_factory) -> tuple[Path, list[str]]:
    """A series within a region that crosses itself and is in degrees; its outputs and warnings."""
    folder = tmp_path_factory.mktemp("series")
    clouds = [write(folder / f"{n}.laz", slope(n)) for n in (1, 2)]
    bow_tie = shapely.Polygon([(X, Y), (X + SIDE, Y + SIDE), (X + SIDE, Y), (X, Y + SIDE)])
    progress = Progress()
    series(folder, *clouds, progress=progress, roi=region(folder / "roi.geojson", bow_tie, 4326))
    return folder / "out", progress.warnings
