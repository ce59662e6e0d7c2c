"""Registration of surveys whose grass differs, against a known motion; what plants hide must not be taken off."""

from __future__ import annotations

import re
from types import SimpleNamespace

import numpy as np
import pytest
from slopewatch.engine.geometry.pose import Pose
from slopewatch.engine.pointcloud.plant_cover import PlantCover
from slopewatch.engine.registration import register as register_module
from slopewatch.engine.registration.bare_ground import divide
from slopewatch.engine.registration.common_vegetation_error import SHARED, common_vegetation_error
from slopewatch.engine.registration.measured import Measured, Solution
from slopewatch.engine.registration.point_to_plane import Matcher
from slopewatch.engine.registration.register import register
from slopewatch.engine.registration.result import RegistrationResult
from slopewatch.engine.registration.surface import Surface
from slopewatch.interface.parameters import RegistrationParameters
from slopewatch.tests.builders.plant_clouds import DIP, SIDE, Grass, Ground, grassy_slope

OFFSET = np.array([0.04, -0.03, 0.07])
TALL, MOWN = Grass(0.25, lifted=0.08), Grass(0.05)


def pair(**options) -> tuple[Ground, Ground]:
    """Grass that lifts the first survey's ground by 8 cm, mown in the second; the second lies off by -OFFSET."""
    first, second = grassy_slope(1, TALL, **options), grassy_slope(2, MOWN, **options)
    return first, Ground(second.xyz - OFFSET, second.plants, second.bare)


def registered(first: Ground, second: Ground, *, told: bool = True) -> tuple[RegistrationResult, np.ndarray, float]:
    """The result, the error of the mean motion (3,), and that of the slope's height at a place, m."""
    plants = (first.plants, second.plants) if told else (None, None)
    found = register(first.xyz, second.xyz, RegistrationParameters(), plants=plants)
    away = (found.transform.apply(second.xyz) - second.xyz - OFFSET).mean(axis=0)
    return found, away, float(away[2] - DIP * away[1])


@pytest.mark.parametrize("across", [False, True])
def test_grass_that_was_mown_is_not_taken_off_where_a_road_is_bare(across):
    first, second = pair(across=across)
    found, away, height = registered(first, second)
    assert found.plants is not None
    assert found.plants.bare_only
    assert abs(away[2]) < 0.01
    assert abs(height) < 0.003
    assert np.linalg.norm(away[:2]) < 0.01, "the grass's relief fixes what a road leaves open"
    assert found.plants.offset == pytest.approx(-0.08, abs=0.005)
    assert abs(height) < 3 * found.registration_error
    assert any(re.search(r"ground under plants lies 0\.0(79|80|81) m lower", w) for w in found.warnings)
    untold, _, wrong = registered(first, second, told=False)
    assert wrong == pytest.approx(0.08, abs=0.005), "what the plants' error is for"
    assert untold.plants is None


def test_a_level_road_across_the_slope_is_not_slid_to_where_the_grass_fits():
    """Road and grass both fit after a slide of 11 cm along the slope: only the relief under the grass tells."""
    found, away, height = registered(*pair(across=True, bench=True))
    assert np.linalg.norm(away) < 0.01
    assert abs(height) < 3 * max(found.registration_error, 0.002)


def test_where_nothing_is_bare_the_error_covers_another_season():
    first, second = pair(bare_share=0.0)
    found, _, height = registered(first, second)
    assert height == pytest.approx(0.08, abs=0.005), "nothing tells it from an offset"
    alike = 0.05 / 0.25
    shared = SHARED * 0.05 * np.sqrt(2.0 * (1.0 - alike))
    assert found.summary()["registration_error_by_plants_m"] == pytest.approx(shared, rel=0.01)
    assert shared <= found.registration_error < 2.0 * shared
    assert any("Too little ground is bare (0%)" in w for w in found.warnings)


def test_vegetation_of_one_season_shifts_both_surveys_alike():
    first, second = (grassy_slope(seed, TALL, bare_share=0.0) for seed in (1, 2))
    found, _, height = registered(first, Ground(second.xyz - OFFSET, second.plants, second.bare))
    assert found.summary()["registration_error_by_plants_m"] < 1e-6
    assert abs(height) < 3.0 * found.registration_error < 0.01


@pytest.mark.parametrize(("second", "error"), [(0.21, 0.01), (0.29, 0.01), (0.15, np.sqrt(0.0025 - 0.0024 * 0.6))])
def test_heights_within_5_cm_are_of_one_season(second, error):
    """Sparse grass measures 3 % differently each time, which is no other season."""
    places = np.random.default_rng(3).uniform(0, 10, (400, 3))
    surfaces = [Surface(places, 0.01, np.full(400, e), np.full(400, h)) for e, h in ((0.03, 0.25), (0.04, second))]
    found = common_vegetation_error(Matcher(*surfaces), Pose.identity(), places)
    assert found == pytest.approx(SHARED * error)


@pytest.mark.parametrize("heights", [(None, 0.25), (0.25, None), (None, None)])
def test_without_the_heights_of_the_vegetation_nothing_cancels(heights):
    places = np.random.default_rng(3).uniform(0, 10, (400, 3))
    errors = 0.03, 0.04
    surfaces = [
        Surface(places, 0.01, np.full(400, error), None if height is None else np.full(400, height))
        for error, height in zip(errors, heights, strict=True)
    ]
    found = common_vegetation_error(Matcher(*surfaces), Pose.identity(), places)
    assert found == pytest.approx(SHARED * 0.05)
    assert common_vegetation_error(Matcher(*surfaces), Pose.identity(), places[:0]) == 0.0


def test_a_scrap_of_bare_ground_is_not_preferred_to_all_the_rest():
    """A patch of 1.5 m in a corner would fix the tilt of the slope worse than the grass of one season does."""
    first, second = (grassy_slope(seed, Grass(0.25, error=0.01 + 0.005), bare_share=0.0) for seed in (1, 2))
    clouds = []
    for ground in (first, second):
        corner = (ground.xyz[:, 0] < 1.5) & (ground.xyz[:, 1] < 1.5)
        clouds.append(Ground(ground.xyz, PlantCover(np.where(corner, 0.0, ground.plants.error)), corner))
    moved = Ground(clouds[1].xyz - OFFSET, clouds[1].plants, clouds[1].bare)
    found, away, _ = registered(clouds[0], moved)
    assert found.plants is not None
    assert not found.plants.bare_only
    assert np.linalg.norm(away) < 0.005


@pytest.mark.parametrize(("ratio", "taken"), [(1.1, True), (1.3, False)])
def test_bare_ground_that_scatters_more_than_all_ground_is_a_wrong_match(monkeypatch, ratio, taken):
    """It slid by 1.8 m to where a few bare places fitted, and stated 2 cm."""
    surface = Surface(np.random.default_rng(4).uniform(0, 5, (500, 3)), 0.01, np.tile([0.0, 0.05], 250))
    ground = divide(Matcher(surface, surface))
    solution = Solution(Pose.identity(), alignment=object())

    def with_scale(scale: float, error: float, by_plants: float) -> Measured:
        return Measured(solution, SimpleNamespace(scale=scale), error, by_plants)

    monkeypatch.setattr(register_module, "align_bare", lambda *_: solution)
    monkeypatch.setattr(register_module, "of_alignment", lambda found: found)
    monkeypatch.setattr(register_module, "measured", lambda *_: with_scale(ratio * 0.02, 0.01, 0.0))
    monkeypatch.setattr(register_module, "offset_of_covered", lambda *_: 0.0)
    whole = with_scale(0.02, 0.05, 0.04)
    found = register_module._surer(whole, None, ground, RegistrationParameters(), False, None)
    assert found.bare == taken


def test_bare_surveys_register_as_if_nothing_were_told():
    first, second = (grassy_slope(seed, Grass(error=0.0)) for seed in (1, 2))
    told, _, _ = registered(first, Ground(second.xyz - OFFSET, second.plants, second.bare))
    untold, _, _ = registered(first, Ground(second.xyz - OFFSET, second.plants, second.bare), told=False)
    assert np.array_equal(told.transform.matrix, untold.transform.matrix)
    assert told.registration_error == untold.registration_error
    assert told.plants is None


def test_one_survey_that_tells_is_enough():
    first, second = pair()
    found = register(first.xyz, second.xyz, RegistrationParameters(), plants=(first.plants, None))
    away = (found.transform.apply(second.xyz) - second.xyz - OFFSET).mean(axis=0)
    assert abs(away[2]) < 0.01


def test_surveys_that_are_bare_in_different_places_register_by_all_ground():
    first, second = (grassy_slope(seed, Grass(0.25, error=0.02), bare_share=0.0) for seed in (1, 2))
    clouds = []
    for ground, west, east in ((first, 0.0, 9.9), (second, 10.1, SIDE)):
        bare = (ground.xyz[:, 0] > west) & (ground.xyz[:, 0] < east)
        clouds.append(Ground(ground.xyz, PlantCover(np.where(bare, 0.0, ground.plants.error)), bare))
    moved = Ground(clouds[1].xyz - OFFSET, clouds[1].plants, clouds[1].bare)
    found, away, _ = registered(clouds[0], moved)
    assert found.plants is not None
    assert not found.plants.bare_only
    assert np.linalg.norm(away) < 0.005
