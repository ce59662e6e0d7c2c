"""Parts of a slope that slid along itself or sank, against known motions: slides alone are left out."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter, map_coordinates
from scipy.spatial.transform import Rotation
from slopewatch.engine.geometry.pose import Pose
from slopewatch.engine.geometry.rigid_transform import RigidTransform
from slopewatch.engine.registration import alignment
from slopewatch.engine.registration.moving_places import Moving, Places
from slopewatch.engine.registration.moving_windows import Windows, consensus
from slopewatch.engine.registration.register import register
from slopewatch.engine.registration.slid_groups import common_motion, contradicting
from slopewatch.engine.registration.surface_patches import Equations, Patches
from slopewatch.engine.registration.unseen_slides import DEVIATIONS, alike, unseen
from slopewatch.interface.parameters import RegistrationParameters

SIDE, STEP, DIP = 26.0, 0.05, np.radians(39.0)
DOWN = np.array([0.0, -np.cos(DIP), -np.sin(DIP)])
NORMAL = np.array([0.0, -np.sin(DIP), np.cos(DIP)])
UTM = np.array([500_000.0, 3_500_000.0, 100.0])


@cache
def relief(smooth: bool = False) -> np.ndarray:
    """Roughness of 4 cm, most of it some decimetres wide: less than a slide. Or smooth waves of some metres."""
    rng = np.random.default_rng(5)
    count = int(SIDE / STEP) + 1
    fields = [gaussian_filter(rng.normal(size=(count, count)), sigma) * sigma for sigma in (3, 6, 16, 30)]
    weights = (0.0, 0.0, 0.1, 0.3) if smooth else (0.05, 0.06, 0.08, 0.0)
    return np.asarray(sum(weight * one for weight, one in zip(weights, fields, strict=True)))


def scan(
    seed: int, share: float = 0.0, way: float = 0.0, *, sunk: float = 0.0, smooth: bool = False
) -> tuple[np.ndarray, np.ndarray]:
    """A slope of 39 degrees, 70 points a square metre, of which a disc with a ``share`` of the area slid by ``way``, or
    was ``sunk`` along the normal, metres.

    Points (n, 3), and which of them rest.
    """
    rng = np.random.default_rng(seed)
    u, v = rng.uniform(1.0, SIDE - 1.0, (2, 40_000))
    away = np.hypot(u - 0.42 * SIDE, v - 0.45 * SIDE)
    inside = away < np.sqrt(share * (SIDE - 2.0) ** 2 / np.pi)
    # the material at a place came from above
    from_v = v + np.where(inside, way, 0.0)
    rise = map_coordinates(relief(smooth), [from_v / STEP, u / STEP], order=1, mode="nearest")
    rise = rise + rng.normal(0, 0.02, u.size) - np.where(inside, sunk, 0.0)
    xyz = np.outer(u, [1.0, 0.0, 0.0]) - np.outer(v, DOWN) + np.outer(rise, NORMAL)
    return UTM + xyz, ~inside


def offset() -> RigidTransform:
    turn = Rotation.from_rotvec([1e-4, -2e-4, 1e-4]).as_matrix()
    return RigidTransform(turn, np.array([0.05, -0.07, 0.04]), UTM + [13.0, 10.0, 8.0])


def pulled(share: float, way: float, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Mean error on what rests down the dip and across it, and the standard errors stated of both, metres."""
    later, rests = scan(100 + seed, share, way)
    moving = offset().inverse().apply(later)
    found = register(scan(seed)[0], moving, RegistrationParameters())
    middle = later[rests].mean(axis=0)
    off = found.transform.apply(moving[rests]).mean(axis=0) - middle
    arm = middle - found.transform.centre
    axes = np.array([DOWN, [1.0, 0.0, 0.0]])
    lever = np.hstack([np.cross(np.eye(3), arm).T, np.eye(3)])
    stated = axes @ lever @ found.covariance @ lever.T @ axes.T
    return axes @ off, np.sqrt(np.diag(stated))


def test_a_slide_does_not_pull_the_rest_along(monkeypatch):
    off, stated = pulled(0.2, 0.15, 1)
    assert np.abs(off).max() < 0.006
    assert (np.abs(off) < 2 * stated).all()
    # the same pair shows that weights by the distance of points do not leave it out
    monkeypatch.setattr(alignment, "moving_places", lambda *_: ())
    off, stated = pulled(0.2, 0.15, 1)
    assert np.abs(off).max() > 0.012
    assert (np.abs(off) > 2 * stated).any()


@pytest.mark.parametrize("sunk", [0.04, 0.3])
@pytest.mark.parametrize("smooth", [False, True])
def test_ground_that_sank_is_not_said_to_have_slid(sunk, smooth):
    later, rests = scan(101, 0.15, sunk=sunk, smooth=smooth)
    found = register(scan(1, smooth=smooth)[0], offset().inverse().apply(later), RegistrationParameters())
    assert found.slid == 0.0
    assert not any("moved along itself" in warning for warning in found.warnings)
    off = found.transform.apply(offset().inverse().apply(later))[rests] - later[rests]
    assert abs(float((off @ NORMAL).mean())) < max(3 * found.registration_error, 0.002)


@pytest.mark.parametrize("smooth", [False, True])
def test_what_stands_still_keeps_its_motion_and_its_error(smooth, monkeypatch):
    clouds = scan(3, smooth=smooth)[0], offset().inverse().apply(scan(103, smooth=smooth)[0])
    found = register(*clouds, RegistrationParameters())
    monkeypatch.setattr(alignment, "moving_places", lambda *_: ())
    plain = register(*clouds, RegistrationParameters())
    assert np.array_equal(found.transform.matrix, plain.transform.matrix)
    assert np.array_equal(found.covariance, plain.covariance)
    assert found.slid == 0.0


def test_a_slide_is_named_with_its_share_of_the_surface():
    later, rests = scan(101, 0.2, 0.15)
    found = register(scan(1)[0], offset().inverse().apply(later), RegistrationParameters())
    assert found.slid == pytest.approx(float(np.mean(~rests)), rel=0.5)
    assert found.summary()["slid_share"] == found.slid
    assert any("moved along itself" in warning for warning in found.warnings)


def patches_of(
    seed: int, slid: float, way: float, *, patchwise: float = 0.0, sunk: float = 0.0
) -> tuple[Windows, np.ndarray]:
    """Windows over 30 x 24 patches of a rough plane, of which those in a disc ask for ``way`` metres along x, and lie
    lower by ``sunk`` (m).

    ``patchwise``: standard deviation (m) of a motion that all patches of a square of 6 m have in common. Also which
    patches slid.
    """
    rng = np.random.default_rng(seed)
    x, y = (axis.ravel() for axis in np.meshgrid(np.arange(30.0) - 15, np.arange(24.0) - 12, indexing="ij"))
    centre = np.column_stack([x, y, np.zeros(x.size)])
    moves = np.hypot(x + 3, y - 1) < np.sqrt(slid * x.size / np.pi)
    square = (np.floor(x / 6) * 100 + np.floor(y / 6)).astype(int)
    common = rng.normal(0, patchwise, (square.max() - square.min() + 1, 2))[square - square.min()]
    matrix, vector, rest = [], [], []
    for number in range(x.size):
        tilt = rng.normal(0, 0.12, (40, 2))
        normal = np.column_stack([tilt, np.ones(40)]) / np.sqrt(1 + (tilt**2).sum(axis=1))[:, None]
        place = centre[number] + np.column_stack([rng.uniform(-0.5, 0.5, (40, 2)), np.zeros(40)])
        terms = np.hstack([np.cross(place, normal) / 12.0, normal])
        asked = np.array([way * moves[number] + common[number, 0], common[number, 1], 0.0])
        within = np.hypot(place[:, 0] + 3, place[:, 1] - 1) < np.sqrt(slid * x.size / np.pi)
        gap = -normal @ asked - sunk * within + rng.normal(0, 0.006, 40)
        matrix.append(terms.T @ terms / 40)
        vector.append(terms.T @ gap / 40)
        rest.append(0.006**2)
    system = Equations(
        np.array(matrix), np.array(vector), np.array(rest), np.zeros((x.size, 6)), np.full(x.size, 40.0), 0.0,
        Pose.identity(),
    )  # fmt: skip
    up = np.tile([0.0, 0.0, 1.0], (x.size, 1))
    patches = Patches(np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64), centre, up, np.ones(x.size), 1.0)
    windows = Windows.of(system, patches, Pose.identity(), 12.0)
    assert windows is not None
    return windows, moves


@pytest.mark.parametrize(("slid", "way"), [(0.1, 0.05), (0.2, 0.2), (0.4, 0.1)])
def test_windows_that_ask_for_another_motion_lose_their_weight(slid, way):
    windows, moves = patches_of(1, slid, way)
    found = consensus(windows, np.eye(6))
    left_out = contradicting(windows, found, np.eye(6)).slid
    assert left_out[moves].mean() > 0.9
    away = np.hypot(windows.centre[:, 0] + 3, windows.centre[:, 1] - 1)
    assert left_out[away > np.sqrt(slid * 720 / np.pi) + 6].mean() < 0.05
    assert np.abs(found.motion[3:5]).max() < 0.004
    everything = windows.solved(np.ones(720), np.eye(6))
    assert everything[3] == pytest.approx(slid * way, rel=0.3)


def test_nothing_is_left_out_of_what_stands_still():
    for seed in range(5):
        windows, _ = patches_of(seed, 0.0, 0.0, patchwise=0.002)
        assert not contradicting(windows, consensus(windows, np.eye(6)), np.eye(6)).slid.any()


@pytest.mark.parametrize("way", [0.05, 0.2])
def test_one_motion_explains_a_slide_and_not_a_sunken_place(way):
    """The slide is found as it was made, where half of the group rests and where none does."""
    slid, moves = patches_of(1, 0.2, way)
    sank, _ = patches_of(1, 0.2, 0.0, sunk=way)
    wide = np.flatnonzero(np.hypot(slid.centre[:, 0] + 3, slid.centre[:, 1] - 1) < np.sqrt(0.4 * 720 / np.pi))
    own = common_motion(slid, np.flatnonzero(moves), np.zeros(6))
    assert own.slid
    assert own.along == pytest.approx(way, rel=0.05)
    assert own.explained > 0.9
    for some in (wide, wide[::2]):
        assert common_motion(slid, some, np.zeros(6)).explained > 3 * common_motion(sank, some, np.zeros(6)).explained
        assert not common_motion(sank, some, np.zeros(6)).slid
    found = consensus(sank, np.eye(6))
    assert not contradicting(sank, found, np.eye(6)).slid.any()


def test_what_a_motion_explains_is_that_of_least_squares():
    """Of patches that mostly slid and partly sank, against numpy's own least squares, with and without the motion."""
    windows, moves = patches_of(3, 0.2, 0.05, sunk=0.01)
    free, both = (0, 1, 5), (0, 1, 3, 4, 5)
    root = np.linalg.cholesky(windows.matrix + 1e-12 * np.eye(6))
    design, right = root.transpose(0, 2, 1), -np.linalg.solve(root, windows.vector[:, :, None])[:, :, 0]

    def left(which: np.ndarray, kept: tuple[int, ...]) -> tuple[float, np.ndarray]:
        stacked, asked = design[which][:, :, kept].reshape(-1, len(kept)), right[which].ravel()
        motion = np.linalg.lstsq(stacked, asked, rcond=None)[0]
        return float(((asked - stacked @ motion) ** 2).sum()), motion

    def taken(number: int, motion: np.ndarray) -> float:
        rest = right[number] - design[number][:, both] @ motion
        single = np.linalg.lstsq(design[number][:, free], rest, rcond=None)[0]
        return float((rest**2).sum() - ((rest - design[number][:, free] @ single) ** 2).sum())

    some = np.flatnonzero(moves)
    (still, _), (slid, motion) = left(some, free), left(some, both)
    noise = np.mean([taken(number, np.zeros(5)) for number in np.flatnonzero(~moves)])
    own = sum(taken(number, motion) for number in some) - len(some) * noise
    found = common_motion(windows, some, np.zeros(6))
    assert found.explained == pytest.approx((still - slid) / (still - slid + own), abs=0.03)
    assert found.explained < 0.97
    assert found.along == pytest.approx(float(np.hypot(*motion[2:4])), rel=0.01)


def test_the_motion_that_a_window_asks_for_is_that_of_least_squares():
    """With offset and tilts left free, against numpy's own least squares on the stacked equations of its patches."""
    windows, _ = patches_of(2, 0.2, 0.1)
    scale, near = windows.scale(2.5, np.ones(720)), windows.near(2.5)
    for number in (0, 350, 500):
        members = near[[number]].indices
        root = [np.linalg.cholesky(windows.matrix[m] + 1e-12 * np.eye(6)) for m in members]
        design = np.concatenate([one.T for one in root])
        right = np.concatenate([-np.linalg.solve(one, windows.vector[m]) for one, m in zip(root, members, strict=True)])
        # without a turn about the normal: shift along both axes at the window's middle
        kept = [0, 1, 3, 4, 5]
        motion = np.zeros(6)
        lever = np.eye(6)
        lever[3:, :3] = np.array([np.cross(windows.centre[number], axis) for axis in np.eye(3)]).T / 12.0
        motion[kept] = np.linalg.lstsq((design @ lever)[:, kept], right, rcond=None)[0]
        own = -np.linalg.solve(scale.information[number], scale.score[number])
        found = np.linalg.lstsq(scale.along[number][:, 3:], own, rcond=None)[0]
        assert found[:2] == pytest.approx(motion[3:5], abs=2e-4)


def test_what_is_not_seen_pulls_by_no_more_than_is_stated():
    """A slide of one window's width just below what is seen, against the pull by brute force."""
    windows, _ = patches_of(4, 0.0, 0.0)
    ones, fixed = np.ones(720), np.eye(6)
    stated = np.sqrt(np.diag(unseen(windows, ones, fixed))[3:5])
    scale = windows.scale(6.0, ones)
    middle = int(np.argmin(np.hypot(*windows.centre[:, :2].T)))
    own = np.sqrt(np.trace(scale.inverse[middle]) / 2 * scale.by_chance(np.zeros(6)))
    inside = windows.near(6.0)[[middle]].indices
    slide = np.array([0.0, 0.0, 0.0, DEVIATIONS * own, 0.0, 0.0])
    vector = windows.vector.copy()
    vector[inside] -= windows.matrix[inside] @ slide
    pull = replace(windows, vector=vector).solved(ones, fixed) - windows.solved(ones, fixed)
    # uniform up to there: the standard deviation is the largest by the root of three
    assert pull[3] / np.sqrt(3) == pytest.approx(stated[0], rel=0.35)


def test_the_covariance_holds_what_neighbours_have_in_common():
    """Motions that squares of 6 m share: the error over seeds by what is stated, which is little without them."""
    ratios, plain = [], []
    ones, fixed = np.ones(720), np.eye(6)
    for seed in range(12):
        windows, _ = patches_of(20 + seed, 0.0, 0.0, patchwise=0.02)
        stated = np.sqrt(np.diag(alike(windows, ones, fixed))[3:5])
        ratios.append(windows.solved(ones, fixed)[3:5] / stated)
        plain.append(stated / np.sqrt(np.diag(alike(patches_of(20 + seed, 0.0, 0.0)[0], ones, fixed))[3:5] + 1e-12))
    assert 0.6 < np.sqrt(np.mean(np.square(ratios))) < 1.6
    assert np.median(plain) > 3


def test_weights_are_those_of_the_nearest_place():
    rng = np.random.default_rng(3)
    centre = rng.uniform(-20, 20, (200, 3))
    places = Places(centre, rng.uniform(0, 1, 200), 1.0)
    # the middles of the blocks, where the nearest place is the block's own
    asked = (np.floor(rng.uniform(-40, 40, (500, 3))) + 0.5) / 2
    nearest = np.argmin(((asked[:, None] - centre[None]) ** 2).sum(axis=2), axis=1)
    assert np.array_equal(places.at(asked), places.weight[nearest])


def test_a_pull_lies_along_the_surface_and_a_tilt_does_not():
    rng = np.random.default_rng(6)
    centre = np.column_stack([rng.uniform(-20, 20, (100, 2)), np.zeros(100)])
    normal = np.tile([0.0, 0.0, 2.0], (100, 1))
    moving = Moving(
        Pose.identity(), Places(centre, np.ones(100), 1.0), normal, slid=0.0, certain=False, unseen=np.eye(6)
    )
    first = Pose.identity().moved(np.array([1e-3, 0.0, 0.0, 0.1, 0.2, 0.3]), 10.0)
    assert moving.along(first, first.moved(np.array([0.0, 0.0, 0.0, 0.02, 0.01, 0.004]), 10.0))
    assert not moving.along(first, first.moved(np.array([0.0, 0.0, 0.0, 0.02, 0.01, 0.01]), 10.0))
    assert not moving.along(first, first.moved(np.array([0.01, 0.0, 0.0, 0.01, 0.0, 0.0]), 10.0))
