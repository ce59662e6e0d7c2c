"""A series of large surveys leaves their points and changes on the disk, and gives the same files."""

from __future__ import annotations

from dataclasses import replace
from datetime import date
from pathlib import Path

import geopandas as gpd
import laspy
import numpy as np
import pytest
import shapely
from pyproj import CRS
from slopewatch.engine.change.difference import difference
from slopewatch.engine.change.epoch_cells import epoch_moments
from slopewatch.engine.epochs.epoch import Epoch
from slopewatch.engine.geometry.rigid_transform import RigidTransform
from slopewatch.engine.grid import stored_cells
from slopewatch.engine.grid.cell_statistics import cell_statistics, sloping_statistics
from slopewatch.engine.grid.common_grid import common_grid
from slopewatch.engine.grid.stored_cells import stored_statistics
from slopewatch.engine.pointcloud import in_parts
from slopewatch.engine.pointcloud.cloud import PointCloud
from slopewatch.engine.pointcloud.in_parts import SpooledCloud, spool
from slopewatch.engine.pointcloud.plant_cover import ERROR, HEIGHT, PlantCover
from slopewatch.engine.pointcloud.writing import write_cloud
from slopewatch.engine.series.kept_changes import KeptChanges
from slopewatch.interface.parameters import ChangeParameters, DisplacementStepParameters, GridChangeParameters
from slopewatch.tests.builders.equal_results import same
from slopewatch.tests.builders.series_clouds import READY
from slopewatch.tests.builders.turned_slope import turned_slope
from slopewatch.workflows import pair, series_preparation
from slopewatch.workflows.series import monitor_series

DAYS = ("2024-05-01", "2024-08-01", "2025-05-01")


@pytest.fixture(scope="module")
def clouds(tmp_path_factory) -> list[Epoch]:
    """Three surveys of a slope with plants, the last one sunk once more."""
    folder = tmp_path_factory.mktemp("series")
    (first, one), (second, two) = turned_slope(30.0)
    found = []
    for day, xyz, cover in zip(DAYS, (first, second, second - [0, 0, 0.02]), (one, two, two), strict=True):
        path = folder / f"{day}.laz"
        known = {ERROR: cover.error.astype("f4"), HEIGHT: cover.height.astype("f4")}
        write_cloud(path, PointCloud(xyz, CRS.from_epsg(32651), path), dimensions=known)
        found.append(Epoch(path, date.fromisoformat(day)))
    return found


@pytest.fixture
def on_disk(monkeypatch):
    """Any cloud is a large one, read in parts of a few thousand points, and gridded in small tiles."""

    def begin() -> None:
        monkeypatch.setattr(pair, "MAX_HELD_POINTS", 0)
        monkeypatch.setattr(in_parts, "_PART_POINTS", 1300)
        monkeypatch.setattr(stored_cells, "_TILE_CELLS", 25)

    return begin


@pytest.mark.parametrize(("bounded", "grows"), [(False, False), (True, False), (False, True)])
def test_the_same_files_as_in_memory(clouds, tmp_path, on_disk, monkeypatch, bounded, grows):
    roi = None
    if bounded:
        roi, low = tmp_path / "roi.gpkg", laspy.read(clouds[0].path).header.mins
        area = shapely.box(low[0] + 3, low[1] + 3, low[0] + 18, low[1] + 20)
        gpd.GeoDataFrame(geometry=[area], crs=32651).to_file(roi)
    # motion along the surface of such surveys: test_series_motion.py
    ready = replace(READY, displacement_step=DisplacementStepParameters(displacement=False))
    if grows:
        ready = replace(ready, change=ChangeParameters(cell=0.25))
    monitor_series(clouds, tmp_path / "held", ready, roi=roi)
    on_disk()
    read = []
    monkeypatch.setattr(series_preparation, "read_cloud", lambda *_, **__: read.append(1))
    monitor_series(clouds, tmp_path / "stored", ready, roi=roi)
    assert not read
    names = {p.relative_to(tmp_path / "held") for p in (tmp_path / "held").rglob("*") if p.is_file()}
    assert len([name for name in names if name.suffix == ".tif"]) == 15
    for name in names - {Path("run.json"), Path("report.html")}:  # these tell when they were made
        assert (tmp_path / "held" / name).read_bytes() == (tmp_path / "stored" / name).read_bytes(), name
    left = {p.relative_to(tmp_path / "stored") for p in (tmp_path / "stored").rglob("*") if p.is_file()}
    assert left == names


def test_cells_of_points_on_the_disk(clouds, tmp_path, on_disk):
    on_disk()
    cloud = spool(clouds[1].path, None, tmp_path / "0.points")
    moved = cloud.moved(RigidTransform(np.eye(3), np.array([0.3, -0.2, 0.1]), np.array([510.0, 910.0, 100.0])))
    xyz = np.concatenate([part for part, _ in moved.parts()])
    # of the survey moved away a part lies outside of the grid
    grid = common_grid(xyz - [1.0, 0.5, 0], xyz - [1.0, 0.5, 0], GridChangeParameters(cell=0.2))
    for sloping, plain in ((True, sloping_statistics), (False, cell_statistics)):
        found, want = stored_statistics(moved, grid, sloping=sloping), plain(xyz, grid)
        for name in ("count", "cell", "height", "variance", "degrees", "leverage", "tilted", "scatter"):
            np.testing.assert_array_equal(getattr(found, name), getattr(want, name), err_msg=name)
        assert found.plant_error is not None
        assert found.plant_height is not None
        assert len(found.plant_height) == len(want.cell) > 1000
    assert not (tmp_path / "0.tiles").exists()


@pytest.mark.parametrize("with_plants", [False, True])
@pytest.mark.parametrize(
    "parameters",
    [
        GridChangeParameters(cell=0.25),
        GridChangeParameters(cell=0.25, threshold="coherent"),
        ChangeParameters(cell=0.25),
    ],
)
def test_changes_come_back_as_they_were(tmp_path, with_plants, parameters):
    (first, one), (second, two) = turned_slope(20.0)
    plants = (one, two) if with_plants else (None, None)
    change = difference(first, second, parameters, plants=plants)
    kept, others = KeptChanges(tmp_path, "some"), KeptChanges(tmp_path, "others")
    kept.add(change)
    others.again(kept, 0)
    assert len(kept) == len(others) == 1
    for again in (kept[0], next(iter(others)), kept[-1:][0]):
        same(again, change)
    assert not any(isinstance(value, np.ndarray) and value.size for value in vars(kept._kept[0].rest).values())


def test_sums_of_points_on_the_disk(clouds, tmp_path, on_disk):
    on_disk()
    cloud = spool(clouds[1].path, None, tmp_path / "0.points")
    parts = list(cloud.parts())
    xyz, known = np.concatenate([part for part, _ in parts]), [cover for _, cover in parts]
    cover = PlantCover(*(np.concatenate([getattr(c, name) for c in known]) for name in ("error", "height")))
    grid = common_grid(xyz, xyz, GridChangeParameters(cell=0.2))
    same(epoch_moments(cloud, grid), epoch_moments(xyz, grid, cover))


def test_a_large_survey_keeps_its_plants_within_an_area(clouds, tmp_path, on_disk):
    on_disk()
    las = laspy.read(clouds[0].path)
    area = shapely.box(*(las.header.mins[:2] + 4), *(las.header.mins[:2] + 12))
    cloud = spool(clouds[0].path, None, tmp_path / "0.points", area=area)
    assert isinstance(cloud, SpooledCloud)
    inside = shapely.contains_xy(area, las.x, las.y)
    assert len(cloud) == inside.sum() < len(las.points)
    assert cloud.values == 2
    error = np.concatenate([cover.error for _, cover in cloud.parts()])
    np.testing.assert_array_equal(error, np.asarray(las[ERROR])[inside])
