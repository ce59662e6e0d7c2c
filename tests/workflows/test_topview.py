"""The rasters of a top view against plain numpy, whatever the parts that the cloud is read in."""

from __future__ import annotations

import json
from pathlib import Path
from types import SimpleNamespace

import laspy
import numpy as np
import pytest
import rasterio
import shapely
from geopandas import GeoDataFrame
from pyproj import CRS
from slopewatch.engine.core.errors import InputError
from slopewatch.engine.core.progress import Progress
from slopewatch.engine.pointcloud import records
from slopewatch.interface.parameters import InputParameters, TopViewParameters
from slopewatch.workflows.products.topview import TOP_VIEW_OUTPUTS
from slopewatch.workflows.topview import topview_step

WEST, SOUTH, WIDTH, HEIGHT = 500_000.0, 3_500_000.0, 24.0, 16.0
EAST_RISE, NORTH_RISE = 0.3, -0.5


def plane(x, y):
    return 100 + EAST_RISE * (x - WEST) + NORTH_RISE * (y - SOUTH)


def write_slope(
    path: Path, *, classified: bool = True, coloured: bool = True, crs: object = 32651, feet: float = 1.0, seed: int = 0
) -> np.ndarray:
    """A plane with shrubs, noise of class 18 far above it; its points with colours and classes, as columns."""
    rng = np.random.default_rng(seed)
    count = 9000
    x, y = np.round(WEST + rng.uniform(0, WIDTH, count), 3), np.round(SOUTH + rng.uniform(0, HEIGHT, count), 3)
    over = np.where(rng.random(count) < 0.3, rng.uniform(0.5, 3.0, count), 0.0)
    z = plane(x, y) + over
    classes = np.where(over > 0, 5, 2).astype(np.uint8)
    noise = rng.random(count) < 0.01
    z[noise], classes[noise] = z[noise] + 50, 18
    header = laspy.LasHeader(point_format=7, version="1.4")
    header.scales, header.offsets = [0.001 / feet] * 3, [WEST / feet, SOUTH / feet, 0]
    if crs is not None:
        header.add_crs(CRS.from_user_input(crs), keep_compatibility=False)
    las = laspy.LasData(header)
    las.x, las.y, las.z = x / feet, y / feet, z / feet
    las.classification = classes if classified else np.where(noise, 18, 1)
    las.intensity = rng.integers(0, 3000, count)
    if coloured:
        las.red, las.green, las.blue = rng.integers(0, 65536, (3, count))
    las.write(path)
    kept = ~noise
    rgb = np.column_stack([las.red, las.green, las.blue])[kept]
    xyz = np.column_stack([las.x, las.y, las.z])[kept] * feet
    return np.column_stack([xyz, classes[kept], rgb >> 8])


def made(cloud: Path, folder: Path, roi: Path | None = None, inputs: InputParameters | None = None, **given) -> dict:
    progress = Progress()
    parameters = TopViewParameters(**given)
    done = topview_step(cloud, folder, parameters, inputs or InputParameters(), roi=roi, progress=progress)
    return {**done.figures, "warnings": progress.warnings}


def read(folder: Path, name: str) -> tuple[np.ndarray, SimpleNamespace]:
    with rasterio.open(folder / f"{name}.tif") as source:
        facts = ("transform", "shape", "height", "width", "bounds", "crs", "descriptions")
        about = SimpleNamespace(**{name: getattr(source, name) for name in facts})
        return source.read(1, masked=True).filled(np.nan) if source.count == 1 else source.read(), about


def cells(points: np.ndarray, source: SimpleNamespace) -> tuple[np.ndarray, np.ndarray]:
    row = np.floor((source.transform.f - points[:, 1]) / source.transform.a - 1e-6).astype(int)
    return row, np.floor((points[:, 0] - source.transform.c) / source.transform.a + 1e-6).astype(int)


@pytest.fixture(scope="module")
def slope(tmp_path_factory):
    folder = tmp_path_factory.mktemp("slope")
    points = write_slope(folder / "slope 2025-05-01.las")
    figures = made(folder / "slope 2025-05-01.las", folder / "out", cell=0.5)
    return folder, points, figures


@pytest.mark.parametrize("name", ["density", "ground_density", "canopy_height", "top_view"])
def test_each_raster_is_that_of_a_loop_over_the_cells(slope, name):
    folder, points, _ = slope
    found, source = read(folder / "out", name)
    row, column = cells(points, source)
    compared = 0
    for i in range(source.height):
        for j in range(source.width):
            here = points[(row == i) & (column == j)]
            if not len(here):
                continue
            compared += 1
            top = here[here[:, 2] == here[:, 2].max()][-1]
            if name == "density":
                assert found[i, j] == len(here) / 0.25
            elif name == "ground_density":
                assert found[i, j] == (here[:, 3] == 2).sum() / 0.25
            elif name == "canopy_height":
                assert found[i, j] == pytest.approx(np.max(here[:, 2] - plane(*here[:, :2].T)), abs=2e-3)
            else:
                assert found[:, i, j].tolist() == [*top[4:7], 255]
    assert compared > 1400


def test_the_hillshade_of_a_plane_is_that_of_its_normal(slope):
    folder, _, _ = slope
    found, _ = read(folder / "out", "hillshade")
    aspect, steepness = np.arctan2(-EAST_RISE, -NORTH_RISE), np.arctan(np.hypot(EAST_RISE, NORTH_RISE))
    shades, weights = [], []
    for azimuth in np.radians([225, 270, 315, 360]):
        shade = np.sin(np.pi / 4) * np.cos(steepness) + np.cos(np.pi / 4) * np.sin(steepness) * np.cos(azimuth - aspect)
        shades.append(max(shade, 0))
        weights.append(np.sin(aspect - azimuth) ** 2)
    wanted = 255 * np.average(shades, weights=weights)
    inner = found[3:-3, 3:-3]
    assert np.nanmedian(inner) == pytest.approx(wanted, abs=1.5)
    # plants are lower than the lowest return of nine cells, nearly everywhere
    assert np.mean(np.abs(inner - wanted) < 6) > 0.95


def test_the_files_are_as_promised(slope):
    folder, points, figures = slope
    out = folder / "out"
    assert {p.name for p in out.iterdir()} == {
        "run.json", *TOP_VIEW_OUTPUTS, "hillshade.qml", "density.qml", "ground_density.qml", "canopy_height.qml",
    }  # fmt: skip
    profiles = set()
    for name in TOP_VIEW_OUTPUTS:
        with rasterio.open(out / name) as source:
            profiles.add((source.transform, source.shape, source.crs))
            assert source.tags(ns="IMAGE_STRUCTURE")["LAYOUT"] == "COG"
            assert source.tags()["EPOCH_TO"] == "2025-05-01"
            assert source.tags()["SOFTWARE"].startswith("SlopeWatch ")
            assert len(source.tags()["INPUT_SHA256"]) == 64
            if name != "top_view.tif":
                assert source.nodata == -9999
                assert source.descriptions[0]
                assert source.units[0] in ("m", "returns/m²", "1")
            else:
                assert source.tags()["DESCRIPTION"] == "Colours of the highest returns"
    assert len(profiles) == 1
    record = json.loads((out / "run.json").read_text())
    assert record["top_view"]["ground"] == "Ground returns (class 2)"
    assert record["metrics"]["points"] == figures["points"] == len(points)
    assert figures["noise_points"] > 50
    assert figures["cell_m"] == 0.5


@pytest.mark.parametrize("given", [{}, {"hillshade": "highest"}, {"ground_returns": "estimate"}])
def test_parts_give_what_the_whole_gives(slope, tmp_path, monkeypatch, given):
    cloud = slope[0] / "slope 2025-05-01.las"
    whole = made(cloud, tmp_path / "whole", cell=0.3, **given)
    monkeypatch.setattr(records, "_GROUP_BYTES", 20_000)
    parts = made(cloud, tmp_path / "parts", cell=0.3, **given)
    assert parts == whole
    for name in TOP_VIEW_OUTPUTS:
        assert (tmp_path / "parts" / name).read_bytes() == (tmp_path / "whole" / name).read_bytes(), name


def test_without_classes_the_ground_is_estimated_and_that_is_said(tmp_path):
    points = write_slope(tmp_path / "raw.las", classified=False)
    figures = made(tmp_path / "raw.las", tmp_path / "out", cell=0.5)
    assert figures["ground"] == "estimate"
    found, source = read(tmp_path / "out", "ground_density")
    assert source.descriptions[0] == "Returns near a quick estimate of the ground per square metre"
    row, column = cells(points, source)
    wanted = np.zeros(source.shape)
    np.add.at(wanted, (row[points[:, 3] == 2], column[points[:, 3] == 2]), 4.0)
    known = np.isfinite(found)
    assert np.mean(found[known] == wanted[known]) > 0.95
    heights, source = read(tmp_path / "out", "canopy_height")
    assert "estimate" in source.descriptions[0]
    true = np.full(source.shape, -np.inf)
    np.maximum.at(true, (row, column), points[:, 2] - plane(*points[:, :2].T))
    assert np.nanmedian(np.abs(heights - true)[np.isfinite(true)]) < 0.06


@pytest.mark.parametrize(("coloured", "picture"), [(True, "rgb"), (False, "intensity")])
def test_the_picture_shows_what_the_cloud_has(tmp_path, coloured, picture):
    write_slope(tmp_path / "raw.las", coloured=coloured)
    assert made(tmp_path / "raw.las", tmp_path / "out")["picture"] == picture
    bands, _ = read(tmp_path / "out", "top_view")
    assert bands[3].mean() > 200
    assert np.ptp(bands[0]) > 150
    assert np.array_equal(bands[0], bands[1]) == (not coloured)


def test_a_region_cuts_it_and_empty_cells_within_have_no_density(tmp_path):
    write_slope(tmp_path / "raw.las")
    roi = tmp_path / "roi.gpkg"
    box = shapely.box(WEST + 2, SOUTH + 2, WEST + 12, SOUTH + 9)
    GeoDataFrame(geometry=[box], crs="EPSG:32651").to_file(roi)
    figures = made(tmp_path / "raw.las", tmp_path / "out", roi=roi, cell=0.1)
    density, source = read(tmp_path / "out", "density")
    assert (source.bounds.right - source.bounds.left, source.bounds.top - source.bounds.bottom) == pytest.approx(
        (10, 7), abs=0.2
    )
    assert np.nansum(density) * 0.01 == pytest.approx(figures["points"])
    assert (density == 0).sum() > 1000, "cells between the points"


def test_the_cell_follows_the_spacing_and_the_memory(tmp_path):
    write_slope(tmp_path / "raw.las")
    assert made(tmp_path / "raw.las", tmp_path / "a")["cell_m"] == 0.5  # points are 0.2 m apart
    with pytest.raises(InputError, match=r"need .* GB, more than the 0.5 GB allowed; give a larger --cell"):
        made(tmp_path / "raw.las", tmp_path / "b", cell=0.005, view_memory=0.5)
    assert not (tmp_path / "b").exists()


def test_feet_become_metres_and_degrees_are_refused(tmp_path):
    foot = 1200 / 3937
    points = write_slope(tmp_path / "feet.las", crs=2225, feet=foot)
    figures = made(tmp_path / "feet.las", tmp_path / "out", cell=0.5)
    assert any("US survey feet" in warning for warning in figures["warnings"])
    _, source = read(tmp_path / "out", "density")
    assert source.bounds.left == pytest.approx(points[:, 0].min(), abs=0.5)
    assert source.crs.linear_units_factor[1] == 1.0
    assert figures["canopy_height_p95_m"] == pytest.approx(2.9, abs=0.3)
    write_slope(tmp_path / "degrees.las", crs=4326)
    with pytest.raises(InputError, match="geographic"):
        made(tmp_path / "degrees.las", tmp_path / "no")
    assert not (tmp_path / "no").exists()


def test_the_vertical_system_stays(tmp_path):
    write_slope(tmp_path / "heights.las", crs="EPSG:32651+5773")
    made(tmp_path / "heights.las", tmp_path / "out", cell=0.5)
    _, source = read(tmp_path / "out", "canopy_height")
    assert "EGM96" in source.crs.to_wkt()


def test_what_cannot_be_is_refused(slope, tmp_path):
    folder, _, _ = slope
    cloud = folder / "slope 2025-05-01.las"
    with pytest.raises(InputError, match="holds results already"):
        made(cloud, folder / "out")
    write_slope(tmp_path / "raw.las", classified=False)
    with pytest.raises(InputError, match="no points of class 2"):
        made(tmp_path / "raw.las", tmp_path / "out", ground_returns="class_2")
    roi = tmp_path / "roi.gpkg"
    GeoDataFrame(geometry=[shapely.box(WEST - 90, SOUTH, WEST - 80, SOUTH + 9)], crs="EPSG:32651").to_file(roi)
    with pytest.raises(InputError, match="within the region of interest"):
        made(tmp_path / "raw.las", tmp_path / "out", roi=roi)
    assert not (tmp_path / "out").exists()
