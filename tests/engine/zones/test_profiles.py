"""Profiles: cells along a line against analytic surfaces, lines from files, the steepest lines through zones."""

from __future__ import annotations

import csv
from datetime import date
from pathlib import Path

import geopandas as gpd
import numpy as np
import pytest
import shapely
from pyproj import CRS
from shapely.geometry import LineString, MultiLineString, Point, Polygon
from slopewatch.engine.core.errors import InputError
from slopewatch.engine.core.progress import Progress
from slopewatch.engine.core.staged_outputs import staged_outputs
from slopewatch.engine.grid.grid import Grid
from slopewatch.engine.zones.profile_lines import GIVEN, ProfileLine, read_lines, steepest_lines
from slopewatch.engine.zones.profiles import Layers, read_profiles, take_profile, write_profiles

GRID = Grid(west=500000.0, north=4000030.0, cell=0.1, rows=300, columns=400)
UTM = CRS(32651)


def centres(grid: Grid = GRID) -> tuple[np.ndarray, np.ndarray]:
    x = grid.west + (np.arange(grid.columns) + 0.5) * grid.cell
    y = grid.north - (np.arange(grid.rows) + 0.5) * grid.cell
    return np.meshgrid(x, y)


def surface(x, y):
    """A slope that falls to the south-east by 0.75, with waves."""
    return 100 - 0.6 * (x - 500000) + 0.45 * (y - 4000000) + 0.2 * np.sin(x - 500000)


def moved(x, y):
    """A bowl of 0.3 m, 6 m wide."""
    return -0.3 * np.exp(-((x - 500020) ** 2 + (y - 4000015) ** 2) / 4.5)


def layers(grid: Grid = GRID) -> Layers:
    x, y = centres(grid)
    dz = moved(x, y)
    level = np.full(grid.shape, 0.05) + 0.01 * (x > 500020)
    before = surface(x, y)
    return Layers(grid, before, before + dz, dz, level, np.abs(dz) > level)


def line(*corners, name: str = "A") -> ProfileLine:
    return ProfileLine(name, LineString([(500000 + x, 4000000 + y) for x, y in corners]), GIVEN)


@pytest.mark.parametrize(
    "corners", [((2, 3), (38, 27)), ((38, 3), (2, 27)), ((20, 1), (20, 29)), ((39, 14.97), (1, 14.97))]
)
def test_values_and_distances_are_those_of_the_surface(corners) -> None:
    given = line(*corners)
    profile = take_profile(given, layers())
    np.testing.assert_allclose(profile.height_from, surface(profile.x, profile.y), atol=1e-5)
    np.testing.assert_allclose(profile.height_to - profile.height_from, moved(profile.x, profile.y), atol=2e-5)
    np.testing.assert_allclose(profile.dz, moved(profile.x, profile.y), atol=1e-7)
    # distance along and beside the line, by the vectors' own products
    start, end = (np.array(c) + (500000, 4000000) for c in corners)
    ahead = (end - start) / np.linalg.norm(end - start)
    away = np.column_stack([profile.x, profile.y]) - start
    np.testing.assert_allclose(profile.distance, away @ ahead, atol=1e-9)
    assert np.abs(away @ np.array([-ahead[1], ahead[0]])).max() <= 0.1 / np.sqrt(2) + 1e-9
    # no gap: a row for each cell's length of the line
    assert np.diff(profile.distance).min() >= 0
    assert np.diff(profile.distance).max() < 0.1 * np.sqrt(2) + 1e-9
    assert len(profile.dz) >= given.geometry.length / (0.1 * np.sqrt(2))
    assert len({*zip(profile.x, profile.y, strict=True)}) == len(profile.x)


def test_distance_goes_on_round_corners() -> None:
    profile = take_profile(line((5, 5), (25, 5), (25, 25)), layers())
    at_end = profile.distance > 25
    np.testing.assert_allclose(profile.distance[at_end], 20 + profile.y[at_end] - 4000005, atol=1e-9)
    assert profile.line.geometry.length == pytest.approx(40)


def test_gaps_and_what_lies_beyond_the_grid_are_left_unknown() -> None:
    of = layers()
    of.dz[:, 180:220] = np.nan
    profile = take_profile(line((-5, 15.05), (45, 15.05)), of)
    assert len(profile.dz) == 400
    assert profile.distance[0] == pytest.approx(5.05)
    np.testing.assert_array_equal(np.isnan(profile.dz), (profile.x > 500018) & (profile.x < 500022))
    facts = profile.facts()
    assert facts["compared_share"] == pytest.approx(0.9)
    assert facts["cells"] == 400
    known = np.abs(profile.x - 500020) > 2
    expected = moved(profile.x, profile.y)[known]
    assert facts["dz_min_m"] == pytest.approx(expected.min(), abs=1e-6)
    assert facts["dz_mean_m"] == pytest.approx(expected.mean(), abs=1e-6)
    level = np.where(profile.x > 500020, 0.06, 0.05)[known]
    assert facts["significant_share"] == pytest.approx(np.mean(np.abs(expected) > level), abs=1e-9)


def test_a_line_beside_the_survey_has_no_cells_and_still_facts() -> None:
    profile = take_profile(line((100, 100), (120, 100)), layers())
    assert len(profile.dz) == 0
    assert profile.facts()["compared_share"] == 0.0
    assert profile.facts()["dz_min_m"] is None


def test_the_steepest_line_runs_down_the_slope_through_the_middle_of_the_change() -> None:
    of = layers()
    zone = Point(500020, 4000015).buffer(2.0)
    frame = gpd.GeoDataFrame({"zone_id": ["Z001"]}, geometry=[zone], crs=UTM)
    (found,) = steepest_lines(frame, of.height_to, of.dz, of.grid, 3)
    assert (found.zone_id, found.kind) == ("Z001", "steepest")
    start, end = np.array(found.geometry.coords)
    x, y = centres()
    # the gradient of the surface's own formula, mean over what the line is fitted to
    near = (np.abs(x - 500020) < 4) & (np.abs(y - 4000015) < 4)
    design = np.column_stack([x[near] - 500020, y[near] - 4000015, np.ones(near.sum())])
    slope = np.linalg.lstsq(design, (surface(x, y) + moved(x, y))[near], rcond=None)[0][:2]
    ahead = (end - start) / np.linalg.norm(end - start)
    assert ahead @ -slope / np.linalg.norm(slope) > 0.9999
    assert found.geometry.distance(Point(500020, 4000015)) < 0.02
    # through the whole zone, and two metres beyond it on both sides
    assert found.geometry.length == pytest.approx(8.0, abs=0.02)
    heights = surface(*np.array([start, end]).T)
    assert heights[0] > heights[1]


def test_on_flat_ground_the_line_follows_the_zone() -> None:
    flat = np.full(GRID.shape, 5.0)
    zone = Polygon([(500010, 4000010), (500020, 4000015), (500019, 4000017), (500009, 4000012)])
    frame = gpd.GeoDataFrame({"zone_id": ["Z001"]}, geometry=[zone], crs=UTM)
    (found,) = steepest_lines(frame, flat, np.full(GRID.shape, 0.2), GRID, 1)
    ahead = np.diff(np.array(found.geometry.coords), axis=0)[0]
    assert abs(ahead @ np.array([2.0, 1.0])) / np.linalg.norm(ahead) / np.sqrt(5) > 0.999


def test_zones_in_a_corner_and_without_neighbours_get_a_line() -> None:
    heights = np.full(GRID.shape, np.nan)
    heights[0, 0] = 3.0
    corner = shapely.box(500000, 4000029.9, 500000.1, 4000030)
    frame = gpd.GeoDataFrame({"zone_id": ["Z001"]}, geometry=[corner], crs=UTM)
    assert steepest_lines(frame, heights, heights, GRID, 1)[0].geometry.length > 2
    assert steepest_lines(frame.iloc[:0], heights, heights, GRID, 1) == ()


def test_lines_of_a_file_in_another_system_with_names(tmp_path: Path) -> None:
    own = gpd.GeoDataFrame(
        {"Name": ["berm, 'upper' <b>", None, "berm, 'upper' <b>"], "other": ["x", "y", "z"]},
        geometry=[
            LineString([(500002, 4000003), (500038, 4000027)]),
            MultiLineString([[(500001, 4000001), (500002, 4000002)], [(500003, 4000003), (500009, 4000003)]]),
            LineString([(500001, 4000001, 7), (500005, 4000002, 9)]),
        ],
        crs=UTM,
    )
    for name, frame in {"a.gpkg": own, "b.geojson": own.to_crs(4326), "c.shp": own.to_crs(32652)}.items():
        frame.to_file(tmp_path / name)
        found, notes = read_lines(tmp_path / name, UTM)
        assert [f.name for f in found] == [
            "berm, 'upper' <b>", "Profile 2", "Profile 2 (2)", "berm, 'upper' <b> (2)",
        ]  # fmt: skip
        assert bool(notes) == (name != "a.gpkg")
        corners = shapely.get_coordinates([f.geometry for f in found])
        np.testing.assert_allclose(corners, shapely.get_coordinates(own.geometry), atol=2e-3)
    assert [f.name for f in read_lines(tmp_path / "a.gpkg", UTM, "other")[0]] == ["x", "y", "y (2)", "z"]


def test_what_is_no_line_is_refused_with_the_remedy(tmp_path: Path) -> None:
    polygon = gpd.GeoDataFrame(geometry=[shapely.box(0, 0, 1, 1)], crs=UTM)
    polygon.to_file(tmp_path / "polygon.gpkg")
    lines = gpd.GeoDataFrame({"a": [1]}, geometry=[LineString([(5e5, 4e6), (7e5, 4e6)])], crs=UTM)
    lines.to_file(tmp_path / "long.gpkg")
    lines.iloc[:0].to_file(tmp_path / "none.gpkg", geometry_type="LineString")
    (tmp_path / "text.gpkg").write_text("no geopackage")
    for name, field, words in (
        ("polygon.gpkg", "", "no lines"),
        ("long.gpkg", "", "200 km long"),
        ("long.gpkg", "b", "no field 'b'"),
        ("none.gpkg", "", "hold no line"),
        ("text.gpkg", "", "cannot be read"),
        ("missing.gpkg", "", "do not exist"),
    ):
        with pytest.raises(InputError, match=words) as error:
            read_lines(tmp_path / name, UTM, field)
        assert name in str(error.value)


def test_files_hold_what_was_taken_and_are_the_same_each_time(tmp_path: Path) -> None:
    names = 'road, "km 3"', "line\nbreak"
    lines = line((2, 3), (38, 27), name=names[0]), line((-9, 5), (9, 5), name=names[1])
    profiles = [take_profile(one, layers()) for one in lines]
    for folder in ("a", "b"):
        with staged_outputs(tmp_path / folder) as stage:
            outputs = write_profiles(profiles, UTM, stage, date(2025, 5, 1))
        assert all(path.is_file() for path in outputs.values())
    for name in ("profiles.gpkg", "profiles.csv"):
        assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes()
    frame = gpd.read_file(tmp_path / "a" / "profiles.gpkg", layer="profiles")
    assert list(frame["name"]) == list(names)
    assert frame.crs == UTM
    assert frame["dz_min_m"].tolist() == [p.facts()["dz_min_m"] for p in profiles]
    back = read_profiles(tmp_path / "a" / "profiles.csv")
    assert list(back) == list(names)
    for profile in profiles:
        np.testing.assert_allclose(back[profile.line.name]["dz_m"], profile.dz, atol=5.1e-5)
        np.testing.assert_allclose(back[profile.line.name]["height_to_m"], profile.height_to, atol=1e-4)
    with (tmp_path / "a" / "profiles.csv").open(newline="") as file:
        assert sum(1 for _ in csv.DictReader(file)) == sum(len(p.dz) for p in profiles)
    with pytest.raises(InputError, match="no table of profiles"):
        read_profiles(tmp_path / "a" / "profiles.gpkg")
    assert Progress().warnings == []
