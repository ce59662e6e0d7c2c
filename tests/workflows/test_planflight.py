"""A planned flight as a whole run: its files, the same lines again, and what is refused."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pyogrio
import pytest
import shapely
from pyproj import Transformer
from slopewatch import api
from slopewatch.engine.core.errors import InputError
from slopewatch.engine.grid.geotiff import read_raster
from slopewatch.engine.vector.geopackage import read_layer
from slopewatch.tests.builders.elevation_models import write_model
from slopewatch.tests.builders.flights import NORTH, WEST, inclined, square, write_region


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("flight")
    write_model(folder / "dem.tif", inclined(relief=2.0).heights, west=WEST, north=NORTH)
    write_region(folder / "roi.gpkg", square())
    api.plan_flight(folder / "dem.tif", folder / "roi.gpkg", folder / "plan", pulse_rate=20000.0, ground_share=0.25)
    return folder


def test_waypoints_lie_over_the_ground_and_in_the_kml(made: Path) -> None:
    """The KML is read by GDAL and brought back by pyproj."""
    points = read_layer(made / "plan" / "plan.gpkg", "waypoints")
    xyz = shapely.get_coordinates(points.geometry, include_z=True)
    ground = inclined(relief=2.0).at(xyz[:, :2])
    assert (xyz[:, 2] - ground).min() >= 40.0 - 0.05
    np.testing.assert_allclose(points["over_ground_m"], xyz[:, 2] - ground, atol=0.05)
    frame = pyogrio.read_dataframe(made / "plan" / "plan.kml", layer="waypoints")
    back = shapely.get_coordinates(frame.geometry, include_z=True)
    x, y = Transformer.from_crs("EPSG:4326", "EPSG:32651", always_xy=True).transform(back[:, 0], back[:, 1])
    np.testing.assert_allclose(np.column_stack([x, y, back[:, 2]]), xyz, atol=0.02)


def test_the_places_hold_what_the_rasters_and_the_record_hold(made: Path) -> None:
    places = read_layer(made / "plan" / "plan.gpkg", "places")
    record = json.loads((made / "plan" / "run.json").read_text(encoding="utf-8"))
    assert places["ground_m2"].to_numpy() == pytest.approx(0.25 * places["returns_m2"].to_numpy())
    assert record["metrics"]["ground_per_m2"] == pytest.approx(places["ground_m2"].median())
    assert record["metrics"]["level_m"] == pytest.approx(places["level_m"].median())
    assert record["metrics"]["slope_deg"] == pytest.approx(np.degrees(np.arctan(0.7)), abs=1.5)
    raster = read_raster(made / "plan" / "expected_ground.tif")
    middle = shapely.get_coordinates(places.geometry.centroid)
    row = ((raster.grid.north - middle[:, 1]) / raster.grid.cell).astype(int)
    column = ((middle[:, 0] - raster.grid.west) / raster.grid.cell).astype(int)
    assert raster.array[row, column] == pytest.approx(places["ground_m2"].to_numpy(), rel=1e-5)
    assert record["metrics"]["flight_time_s"] > record["metrics"]["line_length_m"] / 3.0


def test_the_lines_of_a_plan_are_flown_again_over_a_new_terrain(made: Path) -> None:
    write_model(made / "later.tif", inclined(relief=2.0).heights + 7.0, west=WEST, north=NORTH)
    api.plan_flight(made / "later.tif", made / "roi.gpkg", made / "again", plan=made / "plan" / "plan.gpkg")
    first, again = (read_layer(made / name / "plan.gpkg", "lines") for name in ("plan", "again"))
    for a, b in zip(first.geometry, again.geometry, strict=True):
        p, q = (shapely.get_coordinates(g, include_z=True)[[0, -1]] for g in (a, b))
        np.testing.assert_allclose(q - p, [[0, 0, 7], [0, 0, 7]], atol=0.02)


def test_what_cannot_be_planned_is_refused_and_nothing_is_written(made: Path) -> None:
    write_region(made / "far.gpkg", shapely.transform(square(), lambda xy: xy + 900.0))
    degrees = write_model(made / "degrees.tif", inclined().heights, crs="EPSG:4326", west=121.0, north=30.0, cell=1e-5)
    dem, roi = made / "dem.tif", made / "roi.gpkg"
    for terrain, region, more, words in (
        (dem, made / "far.gpkg", {}, "lies outside of the terrain"),
        (degrees, roi, {}, "geographic"),
        (dem, roi, {"altitude": 8.0}, "raise --altitude"),
        (dem, roi, {"field_of_view": 5.0, "side_overlap": 0.95}, "less than 1 m"),
        (dem, roi, {"margin": 300.0}, "has no height under"),
        (dem, roi, {"plan": roi}, "cannot be read as a vector file with a layer lines"),
        (dem, roi, {"flying_speed": 0.2, "battery_time": 1.0}, "longer than a battery"),
    ):
        with pytest.raises(InputError, match=words) as refused:
            api.plan_flight(terrain, region, made / "refused", **more)
        assert str(refused.value).endswith(".")
        assert "\n" not in str(refused.value)
        assert not (made / "refused").exists()
