"""A planned flight as a whole run: its files, the same lines again, and what is refused."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import numpy as np
import pyogrio
import pytest
import rasterio
import shapely
from pyproj import Transformer
from slopewatch import api
from slopewatch.engine.core.errors import InputError
from slopewatch.engine.elevation_models.model import read_model
from slopewatch.engine.grid.geotiff import read_raster
from slopewatch.engine.vector.geopackage import read_layer
from slopewatch.tests.builders.elevation_models import write_model
from slopewatch.tests.builders.flights import NORTH, WEST, inclined, square, write_region
from slopewatch.tests.builders.season_surveys import SHARES, write_season, write_site
from slopewatch.workflows.conclusions import conclusion


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("flight")
    write_site(folder)
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


def test_of_a_runs_two_surfaces_the_later_one_is_flown_over(made: Path) -> None:
    with rasterio.open(made / "dem.tif") as source:
        heights, profile = source.read(1), source.profile
    bands = [f"Height of the {epoch} surface" for epoch in ("earlier", "later")]
    for name, words in (("surface_heights", bands), ("other", ["red", "green"])):
        with rasterio.open(made / f"{name}.tif", "w", **{**profile, "count": 2}) as target:
            for number, (word, band) in enumerate(zip(words, (heights - 30.0, heights), strict=True), 1):
                target.write(band, number)
                target.set_band_description(number, word)
    flown = {"pulse_rate": 20000.0, "ground_share": 0.25}
    done = api.plan_flight(made / "surface_heights.tif", made / "roi.gpkg", made / "later", **flown)
    assert any("the later one is taken" in sentence for sentence in done.warnings)
    plans = [read_layer(made / name / "plan.gpkg", "waypoints").geometry for name in ("plan", "later")]
    first, again = (shapely.get_coordinates(plan, include_z=True) for plan in plans)
    np.testing.assert_allclose(again, first, atol=1e-6)
    with pytest.raises(InputError, match="has 2 bands; an elevation model has one"):
        api.plan_flight(made / "other.tif", made / "roi.gpkg", made / "no bands", **flown)
    with pytest.raises(InputError, match="has 2 bands"):  # which of them is to be compared is not known
        read_model(made / "surface_heights.tif")


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


def test_the_season_with_the_most_ground_is_named(made: Path) -> None:
    folder = made / "seasons"
    folder.mkdir()
    for day, share in SHARES.items():
        write_season(folder / f"{day}.las", share)
    result = api.plan_flight(
        made / "dem.tif", made / "roi.gpkg", made / "by_season", season=[folder], pulse_rate=20000.0, ground_share=0.25
    )
    found = json.loads((made / "by_season" / "run.json").read_text(encoding="utf-8"))["metrics"]["season"]
    assert (found["best_month"], found["worst_month"], found["as_good"]) == (3, 7, [11])
    for survey in found["surveys"]:
        share = SHARES[survey["date"]]
        assert survey["ground_share"] == pytest.approx(share, abs=0.02)
        assert survey["pulses_per_m2"] == pytest.approx(6.0, rel=0.05)
        assert survey["without_ground_share"] == pytest.approx(np.exp(-24 * share), abs=0.02)
        assert survey["plant_height_m"] == pytest.approx(1.0, abs=0.3)
        # what the plan promises with those plants: its pulses times the share, by medians over places of few counts
        assert survey["planned_ground_per_m2"] == pytest.approx(
            share * result.figures["ground_per_m2"] / 0.25, rel=0.15
        )
    levels = [survey["planned_level_m"] for survey in found["surveys"]]
    assert levels[1] > max(levels[0], levels[2])
    rows = list(csv.DictReader((made / "by_season" / "season.csv").read_text(encoding="utf-8").splitlines()))
    assert [row["month"] for row in rows] == ["3", "7", "11"]
    assert found["strip_ratio"] is None
    assert any("two flight strips over the same places" in sentence for sentence in result.warnings)
    sentences = " ".join(conclusion("planflight", result))
    assert (
        "month 3 shows the most ground: 59 % of the pulses reached it, in month 7 15 %; as good as that: month 11."
        in sentences
    )


def test_one_date_says_nothing_of_seasons_and_the_plan_is_the_same(made: Path) -> None:
    one = write_season(made / "only.las", 0.4)
    result = api.plan_flight(
        made / "dem.tif", made / "roi.gpkg", made / "one", season=[f"2025-06-01={one}"], pulse_rate=20000.0,
        ground_share=0.25,
    )  # fmt: skip
    assert result.figures["season"]["best_month"] is None
    assert any("Only one survey" in sentence for sentence in conclusion("planflight", result))
    for name in ("expected_ground.tif", "expected_level.tif"):
        assert (made / "one" / name).read_bytes() == (made / "plan" / name).read_bytes()


def test_surveys_that_no_season_can_be_read_from_are_refused(made: Path) -> None:
    bare = write_season(made / "raw 2025-05-01.las", 0.4, ground=False)
    far = write_season(made / "far 2025-05-01.las", 0.4, crs=32652)
    for season, words in (
        (write_season(made / "undated.las", 0.4), "holds no date"),
        (bare, "has no ground points"),
        (far, "give both in one reference system"),
        ("2025-13-01=x.las", "is not a date"),
        (made / "missing 2025-05-01.las", "does not exist"),
    ):
        with pytest.raises(InputError, match=words) as refused:
            api.plan_flight(made / "dem.tif", made / "roi.gpkg", made / "no season", season=[season])
        assert str(refused.value).endswith(".")
        assert not (made / "no season").exists()


def test_a_mission_is_written_for_each_battery_and_says_the_same_again(made: Path) -> None:
    aircraft = {
        "wpml_drone": 89, "wpml_payload": 65534, "takeoff_height": "100", "takeoff_ellipsoid_height": "-12.5",
        "battery_time": 1.0, "pulse_rate": 20000.0,
    }  # fmt: skip
    names = []
    for folder in ("mission", "again by mission"):
        result = api.plan_flight(made / "dem.tif", made / "roi.gpkg", made / folder, **aircraft)
        names = sorted(path.name for path in (made / folder).glob("*.kmz"))
        assert len(names) == result.figures["battery_count"] > 1
    for name in names:
        assert (made / "mission" / name).read_bytes() == (made / "again by mission" / name).read_bytes()
    lines = json.loads((made / "mission" / "run.json").read_text(encoding="utf-8"))["missions"]
    assert sorted(number for own in lines.values() for number in own) == list(
        range(1, 1 + result.figures["line_count"])
    )
    # fewer batteries: what is not needed any more goes
    api.plan_flight(
        made / "dem.tif", made / "roi.gpkg", made / "mission", **{**aircraft, "battery_time": 20.0}, overwrite=True
    )
    assert [path.name for path in (made / "mission").glob("*.kmz")] == ["mission_1.kmz"]
    with pytest.raises(InputError, match="--takeoff-height"):
        api.plan_flight(made / "dem.tif", made / "roi.gpkg", made / "refused", wpml_drone=89, wpml_payload=65534)
    assert not (made / "refused").exists()
