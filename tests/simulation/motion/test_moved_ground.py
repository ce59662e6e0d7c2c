"""Ground that moves along itself: it keeps its relief, goes where the truth says, and a slump keeps its volume."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation
from slopewatch.simulation.motion.gliding import Glide, Turn
from slopewatch.simulation.motion.moved_ground import true_motion
from slopewatch.simulation.motion.placing import KINDS
from slopewatch.tests.builders.moving_ground import SLOPE, bare_slope, moving

SLUMP_TOLERANCE = 0.005
"""Of the volume of the scarp by which that of the toe may differ, by an integration of its own."""


@pytest.fixture(scope="module")
def rest():
    return bare_slope()


def scanned(scene, number: int, seed: int) -> np.ndarray:
    """A noise-free scan of the ground at places of its own."""
    rng = np.random.default_rng(seed)
    u, v = rng.uniform(SLOPE[:2], SLOPE[2:], (number, 2)).T
    return np.column_stack([u, v, scene.height(u, v)])


def aligned(patch: np.ndarray, cloud: np.ndarray, start: np.ndarray) -> np.ndarray:
    """``patch`` laid on the surface of ``cloud`` by a rigid motion: nearest points and planes through them."""
    tree, moved = cKDTree(cloud), patch + start
    for _ in range(25):
        _, near = tree.query(moved, k=8)
        around, centre = cloud[near], moved.mean(axis=0)
        middle = around.mean(axis=1)
        normals = np.linalg.svd(around - middle[:, None], full_matrices=False)[2][:, 2]
        off = ((middle - moved) * normals).sum(axis=1)
        keep = np.abs(off) < 3 * np.median(np.abs(off)) + 1e-9
        design = np.column_stack([np.cross(moved - centre, normals), normals])
        solution = np.linalg.lstsq(design[keep], off[keep], rcond=None)[0]
        turn = Rotation.from_rotvec(solution[:3])
        moved = turn.apply(moved - centre) + centre + solution[3:]
    return moved


@pytest.mark.parametrize(
    ("kind", "amount"), [("translation", 0.3), ("translation", 0.02), ("rotation", 0.2), ("slump", 0.3)]
)
def test_nearest_points_of_dense_scans_find_the_true_vector(rest, kind, amount):
    """An alignment of nearest points, which knows nothing of the simulation, finds how the middle has moved."""
    motion = moving(kind, amount)
    before, after = scanned(rest, 400_000, 1), scanned(rest.with_motions((motion,)), 400_000, 2)
    middle = np.array([motion.plane.u + 0.6 * (kind == "rotation"), motion.plane.v])
    patch = before[np.hypot(*(before[:, :2] - middle).T) < 1.2][::4]
    truth = true_motion(rest.with_motions((motion,)).motions[0], rest.base, *patch[:, :2].T).mean(axis=0)
    assert kind == "rotation" or np.linalg.norm(truth) == pytest.approx(amount, rel=0.05)
    near = after[np.hypot(*(after[:, :2] - middle).T) < 2.5]
    # The start is off by 4 cm, so that the surface has to say where it went.
    found = aligned(patch, near, truth + [0.03, -0.02, 0.02]) - patch
    assert found.mean(axis=0) == pytest.approx(truth, abs=0.003)


@pytest.mark.parametrize("kind", KINDS)
def test_every_seen_point_lies_on_the_later_ground_where_the_truth_puts_it(rest, kind):
    moved = rest.with_motions((moving(kind, 0.4),))
    places = scanned(rest, 60_000, 3)
    way = true_motion(moved.motions[0], rest.base, *places[:, :2].T)
    seen = np.isfinite(way[:, 0])
    there = places[seen] + way[seen]
    assert moved.height(there[:, 0], there[:, 1]) == pytest.approx(there[:, 2], abs=2e-4)
    assert np.linalg.norm(way[seen], axis=1).max() == pytest.approx(0.4, rel=0.25)
    assert (np.linalg.norm(way[seen], axis=1) == 0).mean() > 0.4
    assert seen.all() == (kind != "slump")


def test_translation_carries_the_relief_unchanged(rest):
    """Heights above the face in the core are those of the ground uphill, to the last wave."""
    motion = moving("translation", 0.37)
    moved = rest.with_motions((motion,))
    u, v = np.meshgrid(np.linspace(-1.5, 1.5, 120) + motion.plane.u, np.linspace(-1.5, 1.5, 120) + motion.plane.v)
    east, along, up = motion.vector
    assert east == 0
    assert np.hypot(along, up) == pytest.approx(0.37)
    expected = rest.height(u.ravel(), v.ravel() - along) + up
    assert moved.height(u.ravel(), v.ravel()) == pytest.approx(expected, abs=1e-6)
    still = rest.height(u.ravel(), v.ravel())
    # In place, the relief differs by centimetres although no material came or went.
    assert np.std(expected - still) > 0.01
    assert abs(np.mean(expected - still)) < 0.03


def test_rotation_turns_its_core_as_one_and_its_middle_stays(rest):
    motion = moving("rotation", 0.3)
    plane = motion.plane
    u, v = plane.u + np.array([0.0, 1.0, -1.0]), np.full(3, plane.v)
    way = true_motion(motion, rest.base, u, v)
    # The middle moves only by its height above the plane about which the disc turns.
    assert np.linalg.norm(way[0]) < 0.05
    assert np.linalg.norm(way[1] - way[0]) == pytest.approx(motion.angle, rel=0.15)
    assert way[1] - way[0] == pytest.approx(-(way[2] - way[0]), abs=0.05)
    # Distances within the core are kept.
    before = np.column_stack([u, v, rest.height(u, v)])
    spans = [np.linalg.norm(np.diff(places[1:], axis=0)) for places in (before, before + way)]
    assert spans[0] == pytest.approx(spans[1], abs=1e-6)


@pytest.mark.parametrize("amount", [0.1, 0.6])
def test_toe_of_a_slump_holds_what_its_scarp_lost(rest, amount):
    """The volumes by a plain sum of heights at random places, which knows nothing of the motion."""
    moved = rest.with_motions((moving("slump", amount),))
    places = np.random.default_rng(5).uniform(SLOPE[:2], SLOPE[2:], (1_500_000, 2)).T
    change = moved.height(*places) - rest.height(*places)
    area = (SLOPE[2] - SLOPE[0]) * (SLOPE[3] - SLOPE[1]) / change.size
    raised, lowered = change[change > 0].sum() * area, -change[change < 0].sum() * area
    assert lowered > 2 * amount
    sampling = 3 * area * np.sqrt(change.size) * change.std()
    assert raised == pytest.approx(lowered, abs=SLUMP_TOLERANCE * lowered + sampling)
    # Above the middle it sinks, below it rises.
    uphill = places[1] > moved.motions[0].plane.v
    assert change[uphill].mean() < 0 < change[~uphill].mean()


def test_edge_is_soft_for_creep_and_broken_for_a_slump(rest):
    def largest_step(kind: str) -> float:
        motion = moving(kind, 0.5)
        moved = rest.with_motions((motion,))
        v = np.arange(motion.bounds[1], motion.bounds[3], 0.002)
        u = np.full(len(v), motion.plane.u)
        change = moved.height(u, v) - rest.height(u, v)
        return float(np.abs(np.diff(change)).max())

    assert largest_step("creep") < 0.01
    assert largest_step("slump") > 0.05


def test_ground_that_would_fold_is_refused():
    motion = moving("translation", 0.1)
    with pytest.raises(ValueError, match="at most 0"):
        replace(motion, amount=5.0)
    with pytest.raises(ValueError, match="sheared"):
        Turn(motion.plane, 2.0, 1.0)
    with pytest.raises(ValueError, match="compressed"):
        Glide(motion.plane, 2.0, 3.0, 2.5)


def test_grass_goes_with_the_ground_and_is_missing_on_a_fresh_scarp():
    from slopewatch.simulation.fields import HeightField

    rest = bare_slope()
    rng = np.random.default_rng(8)
    turf = HeightField(rest.turf.u0, rest.turf.v0, rest.turf.step, rng.uniform(0.01, 0.05, rest.turf.values.shape))
    moved = replace(rest, turf=turf).with_motions((moving("translation", 0.5),))
    motion = moved.motions[0]
    u, v = np.array([motion.plane.u]), np.array([motion.plane.v])
    assert moved.grass(u, v + motion.vector[1]) == pytest.approx(moved.turf(u, v), abs=1e-9)
    slump = replace(rest, turf=turf).with_motions((moving("slump", 0.6),))
    v = np.arange(motion.plane.v, slump.motions[0].bounds[3], 0.01)
    bare = slump.grass(np.full(len(v), motion.plane.u), v) == 0
    assert 0.2 < bare.sum() * 0.01 < 0.8
