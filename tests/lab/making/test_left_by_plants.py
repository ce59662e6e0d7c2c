"""What plants leave in extracted ground: surplus in patches, holes, returns above; nothing anywhere else."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial import cKDTree
from slopewatch.lab.making import left_by_plants as module
from slopewatch.lab.making.left_by_plants import (
    LEFTOVER_HEIGHT_M,
    SURPLUS_M,
    SURPLUS_WIDTH_M,
    left_by_plants,
)


@pytest.fixture(scope="module")
def lattice() -> np.ndarray:
    i, j = np.meshgrid(np.arange(0, 40, 0.2), np.arange(0, 30, 0.2), indexing="ij")
    return np.column_stack([i.ravel() + 500.0, j.ravel() - 80.0, np.zeros(i.size)])


def _lifts(lattice: np.ndarray, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Lift (n,) of the lattice's points and which are left."""
    made = left_by_plants(lattice, np.random.default_rng(seed))
    apart, number = cKDTree(lattice[:, :2]).query(made[:, :2])
    assert apart.max() == 0
    lift, kept = np.zeros(len(lattice)), np.zeros(len(lattice), dtype=bool)
    lift[number], kept[number] = made[:, 2], True
    assert kept.sum() == len(made)
    return lift, kept


def test_surplus_is_low_smooth_and_in_patches_only(lattice, monkeypatch) -> None:
    monkeypatch.setattr(module, "LEFTOVERS", (1e-12, 1e-11))
    lifted = []
    for seed in range(8):
        lift, _ = _lifts(lattice, seed)
        field = lift.reshape(200, 150)
        assert lift.min() >= 0
        assert lift.max() <= SURPLUS_M[1]
        # Between neighbours 0.2 m apart a blob of 0.5 m width rises by less than its height.
        assert np.abs(np.diff(field, axis=0)).max() < SURPLUS_M[1]
        lifted.append((lift > 0).mean())
    assert 0.005 < np.mean(lifted) < 0.4
    assert min(lifted) < 0.5 * max(lifted)


def test_blobs_keep_company(lattice, monkeypatch) -> None:
    """As many blobs cover fewer squares of 2 m than if they were strewn at random over all of the ground."""
    for name, limits in {
        "COVERED": (0.1, 0.15),
        "PATCHES_M": (12.0, 12.1),
        "SURPLUS_WIDTH_M": (SURPLUS_WIDTH_M[0], 0.6),
        "BLOBS_M2": (1.5, 1.51),
        "LEFTOVERS": (1e-12, 1e-11),
    }.items():
        monkeypatch.setattr(module, name, limits)

    def covered() -> float:
        lifts = np.array([_lifts(lattice, seed)[0] for seed in range(6)])
        return float((lifts.reshape(6, 20, 10, 15, 10).max(axis=(2, 4)) > 0).mean())

    together = covered()

    def strewn(dense: np.ndarray, count: int, rng: np.random.Generator) -> np.ndarray:
        return rng.uniform(0, np.array(dense.shape) - 2, (count, 2))

    monkeypatch.setattr(module, "_drawn", strewn)
    assert 0.05 < together < 0.75 * covered()


def test_holes_lie_where_asked_for_and_leftovers_stand_above(lattice, monkeypatch) -> None:
    monkeypatch.setattr(module, "HOLES_PER_BLOB", (0.0, 0.0))
    assert all(_lifts(lattice, seed)[1].all() for seed in range(4))
    monkeypatch.setattr(module, "HOLES_PER_BLOB", (1.0, 1.0))
    assert 0.01 < 1 - np.mean([_lifts(lattice, seed)[1].mean() for seed in range(6)]) < 0.4
    monkeypatch.setattr(module, "BLOBS_M2", (1e-9, 1e-8))
    monkeypatch.setattr(module, "COVERED", (0.5, 0.51))
    for limits in ((0.01, 0.0101), (0.02, 0.0201)):
        monkeypatch.setattr(module, "LEFTOVERS", limits)
        lifts = [_lifts(lattice, seed)[0] for seed in range(6)]
        above = np.concatenate([lift[lift > 0] for lift in lifts])
        assert LEFTOVER_HEIGHT_M[0] <= above.min() < above.max() <= LEFTOVER_HEIGHT_M[1]
        # Half of the ground has plants.
        assert len(above) / (6 * len(lattice)) == pytest.approx(0.5 * limits[0], rel=0.25)


def test_the_same_generator_leaves_the_same(lattice) -> None:
    one, again = (left_by_plants(lattice, np.random.default_rng(4)) for _ in range(2))
    np.testing.assert_array_equal(one, again)
    assert not np.array_equal(one, left_by_plants(lattice, np.random.default_rng(5)))
