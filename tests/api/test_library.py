"""The library on points in memory: against known changes and motions, and against what the commands write."""

from __future__ import annotations

import inspect
from datetime import date
from pathlib import Path

import geopandas as gpd
import laspy
import numpy as np
import pytest
import rasterio
import shapely
import slopewatch
from pyproj import CRS
from scipy.spatial.transform import Rotation
from slopewatch import api
from slopewatch.engine.geometry.rigid_transform import RigidTransform
from slopewatch.interface.parameters import SurveyParameters, command_sets
from slopewatch.simulation.surveys.survey import simulate_pair
from slopewatch.tests.builders import screening_clouds
from slopewatch.tests.builders.epoch_pairs import X, Y, slope, write
from slopewatch.tests.builders.extracted_ground import write as write_raw
from slopewatch.tests.builders.rough_ground import axes, relief, sampled

DAYS = (date(2024, 5, 1), date(2025, 5, 1))
BLOCK = shapely.box(X + 3, Y + 3, X + 7, Y + 7)
DROP_M = 0.2
AS_IS = {"registration_error": 0.002}


def sunk(seed: int) -> np.ndarray:
    """A slope whose square of 4 m sank."""
    xyz = slope(seed)
    xyz[shapely.contains_xy(BLOCK, xyz[:, 0], xyz[:, 1]), 2] -= DROP_M
    return xyz


@pytest.fixture(scope="module")
def found():
    return slopewatch.change(slope(1), sunk(2), crs="EPSG:32651", dates=DAYS, **AS_IS)


def test_a_block_that_sank_is_a_zone_with_its_volume(found) -> None:
    (zone,) = found.zones.itertuples()
    assert zone.vol_low_m3 <= -DROP_M * BLOCK.area <= zone.vol_high_m3
    assert zone.geometry.intersection(BLOCK).area > 0.9 * BLOCK.area
    assert zone.days == 365
    inside = found.to_xarray().sel(x=slice(X + 4, X + 6), y=slice(Y + 6, Y + 4))
    assert float(inside.change.median()) == pytest.approx(-DROP_M, abs=0.01)
    assert CRS(inside.spatial_ref.crs_wkt).to_epsg() == 32651


def test_arrays_laspy_clouds_and_files_give_one_result(found, tmp_path: Path) -> None:
    paths = [write(tmp_path / f"{day}.laz", xyz) for day, xyz in zip(DAYS, (slope(1), sunk(2)), strict=True)]
    for given in (paths, [laspy.read(path) for path in paths]):
        same = slopewatch.change(*given, dates=DAYS, **AS_IS).to_xarray()
        apart = np.abs(same.change - found.to_xarray().change)
        assert float(apart.median()) < 0.001  # files have millimetres
        assert float(apart.count()) > 0.95 * float(found.to_xarray().change.count())


def test_it_writes_what_the_command_writes(found, tmp_path: Path) -> None:
    paths = [write(tmp_path / f"{day}.laz", xyz) for day, xyz in zip(DAYS, (slope(1), sunk(2)), strict=True)]
    command = api.change(*paths, tmp_path / "command", movement=False, **AS_IS)
    written = slopewatch.change(*paths, **AS_IS).write(tmp_path / "library")
    assert set(written) == set(command.outputs)
    for name in ("elevation_change", "level_of_detection"):
        with rasterio.open(written[name]) as one, rasterio.open(command.outputs[name]) as other:
            np.testing.assert_allclose(one.read(1), other.read(1), atol=1e-9)
    ours, theirs = (gpd.read_file(each["zones"], layer="zones") for each in (written, command.outputs))
    assert ours["vol_net_m3"].tolist() == theirs["vol_net_m3"].tolist()
    assert "2024-05-01" in written["report"].read_text(encoding="utf-8")
    with pytest.raises(api.InputError, match="overwrite"):
        found.write(tmp_path / "library")
    assert found.write(tmp_path / "library", overwrite=True)["zones"].is_file()


def test_a_moved_survey_comes_back_with_its_error() -> None:
    true = RigidTransform(
        Rotation.from_rotvec([0, 0, 0.001]).as_matrix(), np.array([0.05, -0.03, 0.02]), slope(1).mean(axis=0)
    )
    moved = slopewatch.register(slope(1), true.inverse().apply(slope(2)))
    left = moved.transform.apply(true.inverse().apply(slope(3))) - slope(3)
    assert np.abs(left).max() < 0.005
    assert moved.error < 0.005
    change = slopewatch.change(slope(1), moved)
    assert change.result.registration_error == moved.error
    assert change.zones.empty


def test_ground_under_plants(tmp_path: Path) -> None:
    survey = simulate_pair(SurveyParameters(seed=4, points=40_000, length=20.0, height=8.0, vegetation=0.5)).first
    found, true = slopewatch.ground(survey.xyz), survey.truth_ground > 0
    assert (found.mask & true).sum() > 0.8 * true.sum()
    assert (found.mask & ~true).sum() < 0.05 * found.mask.sum()
    with pytest.raises(api.InputError, match="no bare ground"):
        slopewatch.register(survey.xyz, survey.xyz + 0.01)
    las = laspy.read(found.write(tmp_path))
    np.testing.assert_allclose(las.xyz, found.xyz, atol=1e-4)
    assert set(np.unique(las.classification)) == {2}
    np.testing.assert_array_equal(las["plant_error"], found.survey.points.plant_error)


def test_ground_is_that_of_the_command(tmp_path: Path) -> None:
    survey = simulate_pair(SurveyParameters(seed=4, points=40_000, length=20.0, height=8.0, vegetation=0.5))
    path = write_raw(survey, tmp_path / "raw.laz")
    api.extract_ground(path, tmp_path / "ground.laz", strips="off")
    own, theirs = slopewatch.ground(path), laspy.read(tmp_path / "ground.laz")
    by_time = [np.argsort(times) for times in (own.survey.source.gps_time[own.mask], theirs.gps_time)]
    np.testing.assert_allclose(own.xyz[by_time[0]], theirs.xyz[by_time[1]], atol=1e-6)
    np.testing.assert_allclose(own.survey.points.plant_error[by_time[0]], theirs["plant_error"][by_time[1]], atol=1e-6)


def test_a_slide_along_the_surface() -> None:
    heights, slid = relief(24.0, 0.1, seed=1), np.array([0.15, 0.0, 0.0])
    later = sampled(heights, 150, 0.01, 3) + slid @ axes()
    moved = slopewatch.displacement(sampled(heights, 150, 0.01, 2), later, surface_error=0.002)
    motion = moved.to_xarray()
    true = slid @ axes()
    for name, part in zip(("east", "north", "up"), true, strict=True):
        assert float(motion[name].median()) == pytest.approx(part, abs=0.01)
    assert moved.plot() is not None


def test_distances_along_the_normal_of_a_wall(tmp_path: Path) -> None:
    rng = np.random.default_rng(5)

    def wall(shift: float) -> np.ndarray:
        """A wall of 12 by 8 m that faces east, of which a square of 3 m came forward."""
        y, z = rng.uniform((0, 0), (12, 8), (15_000, 2)).T
        block = (np.abs(y - 6) < 1.5) & (np.abs(z - 4) < 1.5)
        return np.column_stack([rng.normal(0, 0.005, y.size) + np.where(block, shift, 0.0), y, z])

    found = slopewatch.m3c2(wall(0.0), wall(0.1), orientation="1,0,0", ground="as_is", registration_error=0.001)
    (zone,) = found.zones.itertuples()
    assert zone.vol_low_m3 <= 0.1 * 9.0 <= zone.vol_high_m3
    values = found.to_xarray()
    block = (np.abs(values.y - 6) < 1) & (np.abs(values.z - 4) < 1)
    assert float(values.distance[block].median()) == pytest.approx(0.1, abs=0.005)
    written = found.write(tmp_path)
    assert len(laspy.read(written["points"]).points) == values.sizes["point"]
    assert written["report"].is_file()


def test_a_series_knows_its_rate(tmp_path: Path) -> None:
    days, rate = (0, 100, 200, 300), 0.001  # metres a day

    def survey(day: int) -> np.ndarray:
        xyz = slope(day)
        xyz[shapely.contains_xy(BLOCK, xyz[:, 0], xyz[:, 1]), 2] -= rate * day
        return xyz

    surveys = {date.fromordinal(DAYS[0].toordinal() + day): survey(day) for day in days}
    found = slopewatch.series(surveys, method="none")
    (zone,) = found.zones.itertuples()
    assert zone.rate_mm_day * zone.area_m2 == pytest.approx(-1000 * rate * BLOCK.area, rel=0.03)  # edges are in it
    last = found.to_xarray().change.isel(day=-1).sel(x=slice(X + 4, X + 6), y=slice(Y + 6, Y + 4))
    assert float(last.median()) == pytest.approx(-rate * days[-1], abs=0.01)
    assert found.write(tmp_path)["report"].is_file()


def test_screening_labels_what_was_given(tmp_path: Path) -> None:
    xyz = screening_clouds.slope()
    labelled = slopewatch.screen(xyz, screening_method="filter", self_test=False)
    for place, label in ((screening_clouds.BULGE, 1), (screening_clouds.HOLLOW, 2)):
        assert np.mean(labelled.labels[screening_clouds.near(xyz, place, 1.0)] == label) > 0.8
    assert np.mean(labelled.labels == 0) > 0.7
    assert labelled.labels.shape == labelled.probability.shape == (len(xyz),)
    las = laspy.read(labelled.write(tmp_path)["labelled"])
    np.testing.assert_array_equal(las["slopewatch_class"], labelled.labels)


def test_feet_become_metres() -> None:
    feet = slope(1) / (1200 / 3937)
    found = slopewatch.change(feet, feet + (0, 0, 1.0), crs="EPSG:2229", **AS_IS)
    assert float(found.to_xarray().change.median()) == pytest.approx(1200 / 3937, abs=1e-6)


@pytest.mark.parametrize(
    ("given", "words"),
    [
        (np.zeros((5, 2)), "shape"),
        (np.zeros((0, 3)), "no points"),
        (np.full((50, 3), np.nan), "finite"),
        (3, "int"),
        ([["a", "b", "c"]], "list"),
        ("nothing.laz", "nothing.laz"),
    ],
)
def test_what_is_no_survey_is_refused_in_one_sentence(given: object, words: str) -> None:
    with pytest.raises(api.InputError, match=words) as caught:
        slopewatch.ground(given)
    assert "\n" not in str(caught.value)


def test_options_are_named_and_documented() -> None:
    for function, sets in ((slopewatch.ground, command_sets.GROUND), (slopewatch.change, command_sets.CHANGE[:4])):
        named, text = inspect.signature(function).parameters, inspect.getdoc(function)
        for specification in (s for group in sets for s in group.specifications()):
            if group_has_no_file(specification.name):
                assert named[specification.name].default == specification.default
                assert f"{specification.name} : " in text
    with pytest.raises(api.InputError, match="did you mean cell"):
        slopewatch.change(slope(1), sunk(2), cel=0.5)


def group_has_no_file(name: str) -> bool:
    """Options of reading files are no options of points in memory, but crs is."""
    return name not in ("height_unit", "crs", "trust_dates")


def test_days_in_reversed_order_are_refused() -> None:
    with pytest.raises(api.InputError, match="earlier"):
        slopewatch.change(slope(1), sunk(2), dates=DAYS[::-1], **AS_IS)
