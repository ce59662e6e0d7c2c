"""Rougher ground and heights in units of a slope's own roughness."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial import cKDTree
from slopewatch.lab.making.natural_relief import ReliefLaw
from slopewatch.lab.making.rough_ground import (
    MAX_ROLLING_M,
    ROLLING_GRADE,
    natural,
    pieces,
    rougher,
    scene_normal,
    texture,
    textured,
    with_relief,
)
from slopewatch.models.configuration import SMOKE
from slopewatch.models.preparation.prepare import NORMAL_30, USUAL_ROUGHNESS, prepare_cloud, roughness
from slopewatch.simulation.hazard_scenes.scenes import scene


def test_texture_has_the_scatter_and_the_reach_asked_for():
    x, y = (a.ravel() for a in np.meshgrid(np.arange(0, 40, 0.2), np.arange(0, 40, 0.2)))
    for reach in (0.3, 0.9):
        field = texture(np.column_stack([x, y]), reach, 0.05, np.random.default_rng(1)).reshape(200, 200)
        assert field.std() == pytest.approx(0.05, rel=0.1)
        # White noise under a Gaussian of s has the correlation exp(-d^2 / (4 s^2)).
        lag = round(reach / 0.2)
        found = np.mean(field[:, lag:] * field[:, :-lag]) / field.var()
        assert found == pytest.approx(np.exp(-((lag * 0.2) ** 2) / (4 * reach**2)), abs=0.1)


def test_points_move_along_the_normal_and_hidden_hazards_are_not_trained_on(small_scene):
    normal = scene_normal(small_scene)
    dip = np.degrees(np.arccos(normal[2]))
    assert dip == pytest.approx(small_scene.dip, abs=1e-6)
    moved = next(s for s in (rougher(small_scene, np.random.default_rng(k)) for k in range(9)) if s is not small_scene)
    shift = moved.xyz - small_scene.xyz
    along = shift @ normal
    np.testing.assert_allclose(shift, along[:, None] * normal, atol=1e-8)
    assert 0.005 < along.std() < 0.12
    newly = moved.ignore & ~small_scene.ignore
    assert (small_scene.label[newly] > 0).all()
    limit = np.abs(small_scene.displacement[newly]).max()
    assert limit == pytest.approx(2 * along.std(), rel=0.25)
    np.testing.assert_array_equal(moved.label, small_scene.label)


def test_roughness_is_that_of_most_of_the_ground():
    rng = np.random.default_rng(2)
    heights = rng.normal(0.1, (0.03, 0.12), (50_000, 2)).astype(np.float32)
    np.testing.assert_allclose(roughness(heights), (0.03, 0.12), rtol=0.03)
    # A fifth of it raised by ten times the scatter changes little.
    heights[:10_000] += 1.2
    np.testing.assert_allclose(roughness(heights), (0.03, 0.12), rtol=0.5)
    assert pytest.approx(np.quantile(np.abs(rng.standard_normal(400_000)), 0.3), abs=0.005) == NORMAL_30


def test_a_slope_twice_as_rough_has_the_same_heights_in_its_own_units(small_scene):
    configuration = replace(SMOKE, own_roughness=True)
    plane = small_scene.to_plane(small_scene.xyz)
    steep = [plane * (1, 1, factor) for factor in (1.0, 1.5)]
    one, other = (prepare_cloud(xyz, configuration).residuals for xyz in steep)
    np.testing.assert_allclose(roughness(one), USUAL_ROUGHNESS, rtol=1e-5)
    np.testing.assert_allclose(roughness(other), USUAL_ROUGHNESS, rtol=1e-5)


def test_rolling_ground_rises_with_its_reach_and_keeps_its_labels(monkeypatch):
    monkeypatch.setattr("slopewatch.lab.making.rough_ground.LEFT_ALONE", 1.0)  # no textures besides
    monkeypatch.setattr("slopewatch.lab.making.rough_ground.BROKEN_SHARE", 0.0)
    wide = scene(1_000_012, "realistic", area=3000.0, density=6.0)
    normal, plane = scene_normal(wide), wide.to_plane(wide.xyz)
    pairs = cKDTree(plane[:, :2]).query_pairs(0.5, output_type="ndarray")
    apart = np.hypot(*(plane[pairs[:, 0], :2] - plane[pairs[:, 1], :2]).T)
    deviations, grades = [], []
    for k in range(40):
        moved = textured(wide, np.random.default_rng(k))
        np.testing.assert_array_equal(moved.label, wide.label)
        np.testing.assert_array_equal(moved.ignore, wide.ignore)
        shift = moved.xyz - wide.xyz
        height = shift @ normal
        np.testing.assert_allclose(shift, height[:, None] * normal, atol=1e-8)
        if not height.any():
            continue
        deviations.append(height.std())
        rise = (height[pairs[:, 0]] - height[pairs[:, 1]]) / apart
        # White noise under a Gaussian of s has a gradient of deviation / (s sqrt(2)) along any direction.
        grades.append(np.sqrt(2 * np.mean(rise**2)))
    assert 8 <= len(deviations) <= 24
    deviations, grades = np.array(deviations), np.array(grades)
    assert deviations.max() < 1.2 * MAX_ROLLING_M
    assert 0.7 * ROLLING_GRADE[0] < grades.min() < 0.05
    assert 0.08 < grades.max() < 1.4 * ROLLING_GRADE[1]
    reaches = deviations / grades
    assert reaches.min() < 2.5 < 4 < reaches.max()
    assert deviations[reaches > np.median(reaches)].mean() > 1.5 * deviations[reaches <= np.median(reaches)].mean()


def test_broken_ground_is_flat_pieces_with_edges_in_patches():
    """Within a piece heights follow a plane, between pieces they jump; some ground stays as it is."""
    x, y = (a.ravel() for a in np.meshgrid(np.arange(0, 50, 0.1), np.arange(0, 40, 0.1)))
    broken = []
    for seed in range(3):
        field = pieces(np.column_stack([x, y]), 2.0, 1.0, 0.1, np.random.default_rng(seed)).reshape(400, 500)
        bend = np.abs(field[:, 2:] - 2 * field[:, 1:-1] + field[:, :-2])
        flat = bend < 0.003  # a patch's fading bends a piece a little
        assert 0.8 < flat.mean() < 0.985
        assert bend[~flat].mean() > 10 * bend[flat].mean()
        broken.append(field[field != 0])
        assert 0.1 < np.mean(field == 0) < 0.9
    assert np.std(np.concatenate(broken)) == pytest.approx(0.07, abs=0.02)  # fading patches take off a third


def test_pieces_are_drawn_out_one_way_and_as_many_as_asked_for():
    x, y = (a.ravel() for a in np.meshgrid(np.arange(0, 60, 0.1), np.arange(0, 60, 0.1)))
    counts = {}
    for stretch in (1.0, 4.0):
        # Level ground within a piece: heights before tilt and patches differ only between pieces.
        rng = np.random.default_rng(5)
        field = pieces(np.column_stack([x, y]), 2.0, stretch, 0.1, rng).reshape(600, 600)
        jumps = [np.abs(np.diff(field, axis=axis)) > 0.03 for axis in (0, 1)]
        counts[stretch] = sorted(j.sum() for j in jumps)
    assert counts[1.0][1] < 1.3 * counts[1.0][0]
    assert counts[4.0][1] > 1.3 * counts[4.0][0]


def test_hazards_lower_than_broken_ground_is_high_are_not_trained_on(monkeypatch):
    monkeypatch.setattr("slopewatch.lab.making.rough_ground.LEFT_ALONE", 1.0)
    monkeypatch.setattr("slopewatch.lab.making.rough_ground.ROLLING_SHARE", 0.0)
    monkeypatch.setattr("slopewatch.lab.making.rough_ground.BROKEN_SHARE", 1.0)
    wide = scene(1_000_012, "realistic", area=3000.0, density=6.0)
    normal, found = scene_normal(wide), 0
    for seed in range(4):
        moved = textured(wide, np.random.default_rng(seed))
        np.testing.assert_array_equal(moved.label, wide.label)
        shift = (moved.xyz - wide.xyz) @ normal
        newly = moved.ignore & ~wide.ignore
        left = (moved.label > 0) & ~moved.ignore
        assert (moved.label[newly] > 0).all()
        assert np.abs(wide.displacement[newly]).max(initial=0.0) <= 2 * shift.std()
        assert np.abs(wide.displacement[left]).min() >= 2 * shift.std() - 1e-6
        found += newly.sum()
    assert found > 0


def test_sixty_per_cent_have_natural_relief_and_smooth_scenes_stay():
    plain = scene(1_000_012, "realistic", area=100.0, density=6.0)
    alike = relief = same = 0
    count = 150
    for seed in range(count):
        former = textured(plain, np.random.default_rng(seed))
        moved = natural(plain, np.random.default_rng(seed))
        same += former is plain
        alike += moved is plain
        np.testing.assert_array_equal(moved.label, plain.label)
        relief += not np.array_equal(moved.xyz, former.xyz)
    assert alike == same
    assert same / count == pytest.approx(0.0975, abs=0.06)
    assert relief / count == pytest.approx(0.6, abs=0.1)


def test_relief_moves_points_along_the_normal_and_hides_low_hazards(small_scene):
    low, high = (
        with_relief(small_scene, np.random.default_rng(3), ReliefLaw(4.0, amount, 20.0, 0.3)) for amount in (0.05, 0.2)
    )
    shift = high.xyz - small_scene.xyz
    along = shift @ scene_normal(small_scene)
    np.testing.assert_allclose(shift, along[:, None] * scene_normal(small_scene), atol=1e-8)
    # The same generator gives the same relief, as high as asked for.
    np.testing.assert_allclose(high.xyz - small_scene.xyz, 4 * (low.xyz - small_scene.xyz), atol=1e-8)
    newly = [moved.ignore & ~small_scene.ignore for moved in (low, high)]
    assert 0 < newly[0].sum() < newly[1].sum()
    for moved, hidden in zip((low, high), newly, strict=True):
        assert (small_scene.label[hidden] > 0).all()
        np.testing.assert_array_equal(moved.label, small_scene.label)
    size = np.abs(small_scene.displacement)
    labelled = (small_scene.label > 0) & ~small_scene.ignore
    assert size[newly[1]].mean() < 0.8 * size[labelled & ~newly[1]].mean()
