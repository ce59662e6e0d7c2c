"""Surveys of ground that moved along itself, and what is written about its motion."""

from __future__ import annotations

import json

import geopandas
import numpy as np
import pytest
import rasterio
from slopewatch.engine.grid.grid import snapped_grid
from slopewatch.interface.parameters import SurveyParameters
from slopewatch.simulation.surveys.series import Creep, simulate_series, survey_days, write_series
from slopewatch.simulation.surveys.survey import motions_of, simulate_pair
from slopewatch.simulation.surveys.write import write_pair

MOVED = SurveyParameters(
    seed=4,
    points=60_000,
    length=48.0,
    height=14.0,
    vegetation=0.0,
    offset=0.1,
    range_noise=0.005,
    motion="all",
    motion_amount=0.3,
)


@pytest.fixture(scope="module")
def pair():
    return simulate_pair(MOVED)


@pytest.fixture(scope="module")
def written(pair, tmp_path_factory):
    return write_pair(pair, tmp_path_factory.mktemp("moved"))


def test_later_survey_lies_on_the_moved_ground(pair):
    """Its own points: not those of the first survey carried along, but echoes of the surface that has moved."""
    later = pair.transform.apply(pair.second.xyz[pair.second.truth_ground == 1])
    on = later[:, 2] - pair.scene.height_at(later)
    at_rest = later[:, 2] - pair.before.height_at(later)
    assert np.median(on) == pytest.approx(0.0, abs=0.006)
    local = pair.scene.frame.to_local(later)
    for motion in pair.motions:
        west, south, east, north = motion.bounds
        inside = (local[:, 0] > west) & (local[:, 0] < east) & (local[:, 1] > south) & (local[:, 1] < north)
        assert np.std(on[inside]) < 0.012
        assert np.std(at_rest[inside]) > 1.3 * np.std(on[inside])
    first = pair.first.xyz[pair.first.truth_ground == 1]
    assert np.std(first[:, 2] - pair.before.height_at(first)) < 0.012
    assert pair.changes == ()


def test_parameters_name_the_motions(pair):
    assert [m.kind for m in pair.motions] == ["translation", "rotation", "creep", "slump"]
    assert motions_of(SurveyParameters(motion="none"), 0.1) == ()
    assert motions_of(SurveyParameters(motion="creep"), 0.0) == ()
    for one, other in zip(pair.motions[:-1], pair.motions[1:], strict=True):
        assert one.bounds[2] < other.bounds[0]
    benched = motions_of(SurveyParameters(motion="slump", height=24.0, benches=2), 0.2)[0]
    # Its middle lies on a face between two berms.
    assert benched.plane.dip == pytest.approx(39.0)
    assert benched.half_along * benched.plane.cosine < 0.5 * 8.0 / np.tan(np.radians(39.0))


def test_true_motion_raster_and_outlines(pair, written):
    with rasterio.open(written["truth_motion"]) as source:
        assert source.descriptions == ("True motion east", "True motion north", "True motion up")
        bands = source.read(masked=True)
        zones = geopandas.read_file(written["truth_zones"])
        middle = [source.index(*geometry.centroid.coords[0]) for geometry in zones.geometry]
    assert list(zones["kind"]) == [m.kind for m in pair.motions]
    for (row, column), zone in zip(middle, zones.itertuples(), strict=True):
        assert bands[:, row, column].filled(np.nan) == pytest.approx([zone.east_m, zone.north_m, zone.up_m], abs=0.04)
    length = np.sqrt((bands.filled(np.nan) ** 2).sum(axis=0))
    assert (length == 0).mean() > 0.6
    assert np.nanmax(length) == pytest.approx(0.3, rel=0.2)
    # Down the dip: the slope faces 150 degrees.
    first = zones.iloc[0]
    assert np.degrees(np.arctan2(first.east_m, first.north_m)) == pytest.approx(150.0, abs=0.1)
    assert np.degrees(np.arctan2(-first.up_m, np.hypot(first.east_m, first.north_m))) == pytest.approx(39.0, abs=0.1)
    slump = zones[zones["kind"] == "slump"].iloc[0]
    assert slump.volume_raised_m3 == pytest.approx(slump.volume_lowered_m3, rel=0.005)
    truth = json.loads(written["truth"].read_text())
    assert [m["kind"] for m in truth["motions"]] == list(zones["kind"])


def test_true_change_is_the_difference_of_the_two_grounds(pair):
    grid = snapped_grid(pair.bounds, 0.5)
    raster = pair.true_change_raster(grid)
    x = grid.west + (np.arange(grid.columns) + 0.5) * grid.cell
    y = grid.north - (np.arange(grid.rows) + 0.5) * grid.cell
    rng = np.random.default_rng(0)
    places = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 1, 2) + rng.uniform(-0.25, 0.25, (1, 300, 2))
    places = places.reshape(-1, 2)
    change = (pair.scene.height_at(places) - pair.before.height_at(places)).reshape(*grid.shape, 300)
    assert np.abs(raster).max() > 0.1
    assert np.abs(raster - change.mean(axis=2)).max() < 0.02
    assert (raster == 0).mean() > 0.5


def test_erosion_is_a_change_everywhere_and_grass_hides_the_ground():
    small = {"seed": 6, "points": 30_000, "length": 14.0, "height": 8.0, "vegetation": 0.0, "amplitude": 0.0}
    weathered = simulate_pair(SurveyParameters(**small, erosion=0.4, grass_growth=0.04))
    grid = snapped_grid(weathered.bounds, 1.0)
    assert (weathered.true_change_raster(grid, 4) != 0).mean() > 0.95
    above = [cloud.xyz[:, 2] - scene.height_at(cloud.xyz) for cloud, scene in ((weathered.first, weathered.before),)]
    later = weathered.transform.apply(weathered.second.xyz)
    above.append(later[:, 2] - weathered.scene.height_at(later))
    assert np.mean(above[1]) - np.mean(above[0]) > 0.005


def test_series_moves_on_from_survey_to_survey(tmp_path):
    parameters = SurveyParameters(
        seed=2, points=12_000, length=16.0, height=10.0, vegetation=0.0, offset=0.0, motion="creep", erosion=0.1
    )
    series = simulate_series(parameters, survey_days(3, 40), (Creep(-0.004, 20.0), Creep(0.001)))
    assert series.slides
    middles = np.array([[m.shape.plane.u, m.shape.plane.v, 0.0] for m in series.motions])
    places = series.scene.frame.to_world(middles)
    paths = write_series(series, tmp_path)
    for number, ways in ((1, (0.08, 0.04)), (2, (0.24, 0.08))):
        with rasterio.open(paths[f"truth_motion_{series.dates[number].isoformat()}"]) as source:
            found = np.array(list(source.sample(places[:, :2])))
        assert np.linalg.norm(found, axis=1) == pytest.approx(ways, rel=0.01)
    grid = snapped_grid((*series.roi.min(axis=0), *series.roi.max(axis=0)), 0.5)
    velocity = np.sqrt(sum(band**2 for band in series.true_velocities(grid).values()))
    assert np.nanmax(velocity) == pytest.approx(0.004, rel=0.02)
    with pytest.raises(ValueError, match="along the surface"):
        series.true_velocity(0, grid)
    for number in (1, 2):
        ground = series.grounds[number]
        cloud = series.clouds[number].xyz
        assert np.median(cloud[:, 2] - ground.height_at(cloud)) == pytest.approx(0.0, abs=0.01)
    truth = json.loads(paths["truth"].read_text())
    assert [m["amount_m"] for m in truth["motions_until_last_survey"]] == [pytest.approx(0.24), pytest.approx(0.08)]
