"""Ground among simulated points whose truth is known: how much is found, how much of it is ground, what is refused."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import shapely
from slopewatch.engine.core.errors import InputError
from slopewatch.engine.ground.filtering import dominant_plane, ground_mask, known_ground
from slopewatch.interface.parameters import GroundParameters, SurveyParameters
from slopewatch.simulation.surveys.survey import SimulatedPair, simulate_pair


class Scene:
    """The points of a survey within its region, which are ground and which last returns."""

    def __init__(self, pair: SimulatedPair) -> None:
        cloud, polygon = pair.first, shapely.Polygon(pair.roi)
        inside = shapely.contains_xy(polygon, cloud.xyz[:, 0], cloud.xyz[:, 1])
        self.xyz, self.ground = cloud.xyz[inside], cloud.truth_ground[inside] == 1
        self.last = (cloud.return_number == cloud.number_of_returns)[inside]

    def shares(self, found: np.ndarray) -> tuple[float, float]:
        """Recall and precision."""
        right = (found & self.ground).sum()
        return right / self.ground.sum(), right / found.sum()


@pytest.fixture(scope="module")
def slope() -> Scene:
    """39 degrees, 70 % of it under plants."""
    return Scene(simulate_pair(SurveyParameters(seed=3, points=130_000, length=20.0, height=10.0)))


def test_the_slope_laid_flat_gives_the_ground_where_the_cloth_alone_loses_it(slope):
    recall, precision = slope.shares(ground_mask(slope.xyz, last=slope.last))
    assert recall >= 0.98
    assert precision >= 0.97
    cloth = GroundParameters(refine=False, class_threshold=0.1)
    flat, _ = slope.shares(ground_mask(slope.xyz, cloth, slope.last))
    unrotated, _ = slope.shares(ground_mask(slope.xyz, replace(cloth, slope_aligned=False), slope.last))
    published, _ = slope.shares(ground_mask(slope.xyz, GroundParameters.build(profile="paper")))
    assert unrotated < 0.7 < 0.9 < flat
    assert published < 0.9


def test_without_return_numbers_the_ground_is_nearly_the_same(slope):
    recall, precision = slope.shares(ground_mask(slope.xyz))
    assert recall >= 0.98
    assert precision >= 0.965


def test_the_plane_is_that_of_the_ground(slope):
    ground = slope.xyz[slope.ground]
    _, _, axes = np.linalg.svd(ground - ground.mean(axis=0), full_matrices=False)
    assert abs(dominant_plane(slope.xyz).normal @ axes[2]) > np.cos(np.radians(2.0))


def test_berms_are_found_from_the_ground_beside_them():
    scene = Scene(
        simulate_pair(SurveyParameters(seed=5, points=90_000, length=14.0, height=14.0, angle=45.0, benches=2))
    )
    recall, precision = scene.shares(ground_mask(scene.xyz, last=scene.last))
    cloth, _ = scene.shares(ground_mask(scene.xyz, GroundParameters(refine=False, class_threshold=0.1), scene.last))
    assert recall > 0.86
    assert precision > 0.95
    assert cloth < recall


def test_strays_take_nothing_away(slope):
    strays = slope.xyz[np.flatnonzero(slope.ground)[:8]].copy()
    strays[:, 2] += [-1e6, -5.0, -5.0, -2.5, 40.0, 1e5, -300.0, -8.0]
    strays[3, :2] += 1e5
    clean = ground_mask(slope.xyz, last=slope.last)
    found = ground_mask(np.vstack([slope.xyz, strays]), last=np.append(slope.last, np.ones(8, bool)))
    assert not found[-8:].any()
    assert np.count_nonzero(found[:-8] != clean) < 0.005 * np.count_nonzero(clean)


def test_a_low_stray_takes_all_away_without_denoising(slope):
    stray = slope.xyz.mean(axis=0, keepdims=True) - [0, 0, 60.0]
    found = ground_mask(np.vstack([slope.xyz, stray]), GroundParameters(denoise=False, refine=False))
    assert np.count_nonzero(found) < 0.05 * np.count_nonzero(slope.ground)


def test_points_that_are_not_finite_are_no_ground_and_too_many_are_refused(slope):
    xyz = slope.xyz.copy()
    xyz[::2000, 0] = np.nan
    xyz[1::4000, 2] = np.inf
    finite = np.isfinite(xyz).all(axis=1)
    found = ground_mask(xyz, last=slope.last)
    assert not found[~finite].any()
    assert np.array_equal(found[finite], ground_mask(xyz[finite], last=slope.last[finite]))
    xyz[::500, 1] = np.nan
    with pytest.raises(InputError, match="not finite"):
        ground_mask(xyz)


def test_the_same_points_give_the_same_ground_in_any_place(slope):
    found = ground_mask(slope.xyz, last=slope.last)
    assert np.array_equal(found, ground_mask(slope.xyz, last=slope.last))
    moved = ground_mask(slope.xyz + [3_000_000.0, -2_000_000.0, 500.0], last=slope.last)
    # cells of the plane's search begin elsewhere only by rounding
    assert np.count_nonzero(found != moved) < 0.005 * np.count_nonzero(found)


@pytest.mark.parametrize(
    "xyz",
    [np.zeros((3, 3)), np.arange(60.0)[:, None] * [1.0, 2.0, 0.5], np.zeros((500, 3))],
    ids=["three", "on a line", "one place"],
)
def test_too_little_to_find_ground_in_is_refused(xyz):
    with pytest.raises(InputError, match="region"):
        ground_mask(xyz)


def test_known_ground_tells_of_the_plants_over_it():
    """Half of the slope under grown grass: a mask as before, and errors there, in vertical metres."""
    pair = simulate_pair(
        SurveyParameters(
            seed=4, points=60_000, length=14.0, height=7.0, angle=45.0, vegetation=0.0, grass=0.5, layout="left"
        )
    )
    scene = Scene(pair)
    found = known_ground(scene.xyz, last=scene.last)
    assert np.array_equal(found.mask, ground_mask(scene.xyz, last=scene.last))
    plants = found.plants
    assert plants is not None
    assert plants.height is not None
    assert len(plants.error) == len(plants.height) == found.mask.sum()
    left = pair.scene.frame.to_local(scene.xyz[found.mask])[:, 0] < 5.0
    right = pair.scene.frame.to_local(scene.xyz[found.mask])[:, 0] > 9.0
    assert np.median(plants.error[left]) > 0.018 * np.sqrt(2)
    assert np.median(plants.error[right]) == 0.0
    assert np.median(plants.height[left]) == pytest.approx(0.2, abs=0.1)
    assert known_ground(scene.xyz, GroundParameters(refine=False)).plants is None
