"""Ground that another survey helps to find, on surfaces that are known by construction."""

from __future__ import annotations

import numpy as np
import pytest
from slopewatch.engine.ground.shared_ground import Survey, shared_ground

SIDE, HOLE, THRESHOLD = 24.0, 4.0, 0.06
MIDDLE = np.array([12.0, 12.0])


def height(xy, bump=0.0):
    """A slope of 25 degrees with ridges of 1 m, and a cosine bump over the hole."""
    share = np.minimum(np.hypot(*(xy - MIDDLE).T) / HOLE, 1.0)
    relief = 0.47 * xy[:, 0] + 0.5 * np.sin(xy[:, 0] + 0.5 * xy[:, 1])
    return relief + bump * np.cos(0.5 * np.pi * share) ** 2


def survey(seed, bump=0.0, *, seen=True, stripped=None, object_m=0.0, scatter_m=1.0, per_m2=4.0):
    """Returns of ground (1 of 4) and of vegetation above it, ``seen`` as ground or not within the hole.

    ``stripped`` takes the true ground away there; an object that is ``object_m`` high stands there instead.
    """
    random = np.random.default_rng(seed)
    xy = random.uniform(0.0, SIDE, (int(per_m2 * SIDE**2), 2))
    truth = random.random(len(xy)) < 0.4
    z = height(xy, bump) + random.normal(0.0, 0.02, len(xy))
    z += np.where(truth, 0.0, 0.25 + random.gamma(2.0, scatter_m, len(xy)))
    hole = np.hypot(*(xy - MIDDLE).T) < HOLE
    if stripped is not None:
        z = np.where(hole & truth, height(xy) + stripped(random, len(xy)), z)
    known = truth & (seen | ~hole)
    return Survey(np.column_stack([xy, z]), known, np.ones(len(xy), dtype=bool)), truth, hole


@pytest.mark.parametrize("bump", [0.5, -0.5, 0.3, 0.0])
def test_ground_that_changed_is_found(bump):
    other, _, _ = survey(1)
    own, truth, hole = survey(2, bump, seen=False)
    found = shared_ground(own, other, THRESHOLD)
    right = np.abs(own.xyz[found.index, 2] - height(own.xyz[found.index, :2], bump)) < 0.15
    assert right.mean() > 0.95
    inner = np.flatnonzero(truth & (np.hypot(*(own.xyz[:, :2] - MIDDLE).T) < HOLE - 1.5))
    assert np.isin(inner, found.index).mean() > 0.7
    assert not own.ground[found.index].any()
    assert hole[found.index].all()
    assert np.abs(found.height).max() < 0.3
    assert (found.plant_error >= 0).all()


def flat_top(random, count):
    return 0.45 + random.normal(0.0, 0.02, count)


def crowns(random, count):
    return 0.2 + random.gamma(2.0, 0.3, count)


@pytest.mark.parametrize("shape", [flat_top, crowns])
def test_vegetation_that_both_surveys_hold_is_no_ground(shape):
    """Some returns of the other survey reach the ground below it, none of this one do; single ones may lie near it."""
    first, truth, hole = survey(1)
    random = np.random.default_rng(5)
    over = hole & truth & (random.random(len(hole)) < 0.85)
    xyz = first.xyz.copy()
    xyz[over, 2] = height(xyz[over, :2]) + shape(random, int(over.sum()))
    other = Survey(xyz, first.ground & ~over, first.taken)
    own, truth, hole = survey(2, seen=False, stripped=shape)
    assert len(shared_ground(own, other, THRESHOLD).index) < 0.05 * np.count_nonzero(truth & hole)


def test_new_crowns_are_no_ground():
    other, _, _ = survey(1)
    own, _, _ = survey(2, seen=False, stripped=crowns)
    assert not len(shared_ground(own, other, THRESHOLD).index)


def test_a_new_object_with_returns_below_it_is_no_ground():
    other, _, _ = survey(1)

    def hedge(random, count):
        return np.where(random.random(count) < 0.25, 0.0, 0.6) + random.normal(0.0, 0.02, count)

    own, _, _ = survey(2, seen=False, stripped=hedge)
    index = shared_ground(own, other, THRESHOLD).index
    assert (own.xyz[index, 2] - height(own.xyz[index, :2]) < 0.3).all()


def test_returns_that_may_not_be_ground_stay_so():
    other, _, _ = survey(1)
    own, _, hole = survey(2, 0.5, seen=False)
    taken = ~hole
    assert not len(shared_ground(Survey(own.xyz, own.ground, taken), other, THRESHOLD).index)


def test_without_the_other_ground_none_is_found():
    other, _, _ = survey(1, seen=False)
    own, _, _ = survey(2, 0.5, seen=False)
    away = np.hypot(*(own.xyz[shared_ground(own, other, THRESHOLD).index, :2] - MIDDLE).T)
    assert (away > HOLE - 1.5).all()
