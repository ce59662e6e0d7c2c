"""Patches of ground with hazards: as points would have them, the same by the same seed, every change sound."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from slopewatch.engine.core.errors import InputError
from slopewatch.engine.geometry.hazard_shapes import displacement_at, smooth_hazard
from slopewatch.models.preparation.bump_filter import cell_heights
from slopewatch.models.preparation.inserted_hazards import displacement_on_cells, footprint
from slopewatch.models.training.relief_patches import (
    Ground,
    PatchParameters,
    cell_labels,
    cut,
    draw_patch,
    insert_on_cells,
    wanted_hazards,
)

PLAIN = PatchParameters(
    side=48,
    densities=(1000.0, 1000.1),
    steepening=(1.0, 1.0001),
    turned=0.0,
    tilt_deg=0.0,
    strips=0.0,
    holes=0.0,
    structures=0.0,
)


def hill(dip_deg: float = 30.0, density: float = 8.0, side: float = 60.0) -> np.ndarray:
    """A slope that dips to the south, rough by 3 cm."""
    rng = np.random.default_rng(1)
    points = rng.uniform(0, side, (round(density * side**2), 3))
    points[:, 2] = 700.0 + np.tan(np.radians(dip_deg)) * points[:, 1] + rng.normal(0, 0.03, len(points))
    return points


def test_hazards_added_to_cells_equal_hazards_added_to_points() -> None:
    rng = np.random.default_rng(2)
    points = np.column_stack([rng.uniform(0, 40, (16000, 2)), rng.normal(0, 0.02, 16000)])
    cells = cell_heights(points, 0.5, np.zeros(2), (80, 80))
    hazard = replace(smooth_hazard(0.6, 5.0, rng), u=20.1, w=19.7)

    moved = np.zeros((80, 80))
    i, j, values = displacement_on_cells(hazard, cells.origin, cells.cell, (80, 80))
    moved[i, j] = values
    lifted = points.copy()
    lifted[:, 2] += displacement_at(hazard, points[:, 0], points[:, 1])
    difference = cell_heights(lifted, 0.5, np.zeros(2), (80, 80)).height - (cells.height + moved)
    # Cells of two or three points do not find a steep flank's inclination exactly.
    assert np.sqrt(np.nanmean(difference[moved > 0] ** 2)) < 0.04 * 0.6
    assert abs(np.nanmean(difference[moved > 0])) < 0.01
    assert np.nanmax(np.abs(difference[moved == 0])) < 0.06


def test_labels_are_the_footprints_of_the_hazards() -> None:
    rng = np.random.default_rng(3)
    points = np.column_stack([rng.uniform(0, 40, (8000, 2)), np.zeros(8000)])
    cells = cell_heights(points, 0.5, np.zeros(2), (80, 80))
    wanted = [smooth_hazard(height, 4.0, rng) for height in (0.5, -0.5)]
    moved, labels = insert_on_cells(cells, wanted, points, rng)
    assert (labels[moved > 0.05] == 1).all()
    assert (labels[moved < -0.05] == 2).all()
    assert not labels[moved == 0].any()
    up, down = footprint(replace(wanted[0], u=20.0, w=20.0), np.zeros(2), 0.5, (80, 80))
    assert np.count_nonzero(labels == 1) == pytest.approx(up.sum(), rel=0.06)
    assert not down.any()


def test_a_patch_lies_flat_with_y_up_the_slope() -> None:
    points = hill()
    points[:, 2] += 0.5 * (np.abs(points[:, 1] - 30) < 1)  # a berm along the slope
    for seed in range(3):
        part = cut(Ground("hill", points, 8.0, scales=(1.0, 1.0001)), PLAIN, np.random.default_rng(seed))
        assert part is not None
        flat = part.flat
        high = flat[flat[:, 2] > np.median(flat[:, 2]) + 0.25]
        assert np.abs(flat[:, 2]).max() < 1.0
        assert flat[:, :2].min() >= 0
        assert flat[:, :2].max() < 32.0
        assert np.ptp(high[:, 0]) > 20
        assert np.ptp(high[:, 1]) < 3.5


def test_shrunk_ground_is_denser_and_lower() -> None:
    points = hill(dip_deg=10.0)
    points[:, 2] += 0.4 * np.sin(points[:, 0])
    whole, half = (
        cut(Ground("hill", points, 8.0, scales=(s, 1.0001 * s)), PLAIN, np.random.default_rng(7)) for s in (1.0, 0.5)
    )
    assert whole is not None
    assert half is not None

    def density(flat: np.ndarray) -> float:
        return float(np.median(np.unique(np.floor(flat[:, :2]), axis=0, return_counts=True)[1]))

    assert density(half.flat) / density(whole.flat) == pytest.approx(4.0, rel=0.15)
    assert half.flat[:, 2].std() / whole.flat[:, 2].std() == pytest.approx(0.5, rel=0.1)


def test_points_are_thinned_to_the_density_drawn() -> None:
    ground = Ground("hill", hill(0.0), 8.0, scales=(1.0, 1.0001))
    part = cut(ground, replace(PLAIN, densities=(2.0, 2.0001)), np.random.default_rng(1))
    assert part is not None
    cells = np.unique(np.floor(part.flat[:, :2] / 4), axis=0, return_counts=True)[1]
    assert np.median(cells) / 16 == pytest.approx(2.0, rel=0.1)


def test_the_same_seed_gives_the_same_patch() -> None:
    ground = Ground("hill", hill(), 8.0)
    parameters = PatchParameters(side=48)
    first, again, other = (draw_patch([ground], parameters, np.random.default_rng([4, k])) for k in (1, 1, 2))
    np.testing.assert_array_equal(first.channels, again.channels)
    np.testing.assert_array_equal(first.labels, again.labels)
    assert np.abs(other.channels - first.channels).max() > 0.1
    assert first.channels.shape[1:] == first.labels.shape == (48, 48)


def test_hazards_come_independently_of_each_other() -> None:
    """As many on a patch as chance has it: the scatter of their number is that of Poisson's distribution."""
    ground = Ground("flat", hill(0.0), 8.0, scales=(1.0, 1.0001))
    part = cut(ground, PLAIN, np.random.default_rng(1))
    assert part is not None
    cells = cell_heights(part.flat, 0.5, np.zeros(2), (64, 64))
    parameters = PatchParameters(side=48, filled=0.5)
    counts = [len(wanted_hazards(cells, parameters, np.random.default_rng(k))) for k in range(60)]
    area = np.count_nonzero(cells.covered) * 0.25
    drawn = np.exp(np.linspace(*np.log(parameters.diameters), 10001))
    assert np.mean(counts) == pytest.approx(0.5 * area / np.mean(np.pi / 4 * drawn**2), rel=0.1)
    assert 0.6 < np.var(counts) / np.mean(counts) < 1.6


def test_labels_follow_the_heights_when_they_are_mirrored() -> None:
    ground = Ground("flat", hill(0.0), 8.0, scales=(1.0, 1.0001))
    parameters = replace(PLAIN, heights=(1.0, 1.1), needs=(20.0, 21.0), varied=0.0, diameters=(4.0, 4.1))
    for seed in range(4):
        patch = draw_patch([ground], parameters, np.random.default_rng(seed))
        for one in (patch, patch.mirrored(along=True), patch.mirrored(upside_down=True)):
            for label, sign in ((1, 1), (2, -1)):
                inside = one.channels[3][one.labels == label]
                assert not len(inside) or np.mean(sign * inside > 0) > 0.8
        again = patch.mirrored(along=True, upside_down=True).mirrored(along=True, upside_down=True)
        np.testing.assert_array_equal(again.channels, patch.channels)
        np.testing.assert_array_equal(again.labels, patch.labels)
        assert np.count_nonzero(patch.mirrored(upside_down=True).labels == 1) == np.count_nonzero(patch.labels == 2)


def flat_ground(reach: float, density: float, seed: int = 1) -> np.ndarray:
    rng = np.random.default_rng(seed)
    count = round(density * reach**2)
    return np.column_stack([rng.uniform(0, reach, (count, 2)), rng.normal(0, 0.02, count)])


def labels_of_cells(flat: np.ndarray, labels: np.ndarray, shape: tuple[int, int]) -> np.ndarray:
    column, row = np.floor(flat[:, :2].T / 0.5).astype(np.int64)
    return cell_labels(column, row, labels, shape)


def test_cells_have_the_class_of_most_of_their_points() -> None:
    rng = np.random.default_rng(5)
    flat = flat_ground(6.0, 16.0)
    labels = rng.choice(np.array([0, 1, 2, 255], dtype=np.uint8), len(flat), p=[0.5, 0.2, 0.15, 0.15])
    found = labels_of_cells(flat, labels, (14, 12))
    kinds = set()
    for i in range(14):
        for j in range(12):
            inside = (np.floor(flat[:, 0] / 0.5) == i) & (np.floor(flat[:, 1] / 0.5) == j)
            votes = sorted(((labels[inside] == kind).sum(), kind) for kind in (0, 1, 2, 255))
            wanted = votes[-1][1] if votes[-1][0] > votes[-2][0] else 255
            assert found[i, j] == wanted
            kinds.add(wanted if votes[-1][0] else "empty")
    assert kinds == {0, 1, 2, 255, "empty"}


@pytest.mark.parametrize("varied", [False, True])
def test_hazards_are_put_in_beside_labelled_ground_only(varied: bool) -> None:
    """Labelled discs and an unknown corner on ground that is full of wanted hazards."""
    flat = flat_ground(40.0, 9.0)
    cells = cell_heights(flat, 0.5, np.zeros(2), (80, 80))
    labels = np.zeros(len(flat), dtype=np.uint8)
    for number, (x, y) in enumerate(((10.0, 12.0), (27.0, 30.0), (30.0, 9.0))):
        labels[np.hypot(flat[:, 0] - x, flat[:, 1] - y) < 2.5] = 1 + number % 2
    labels[flat[:, :2].max(axis=1) < 7.0] = 255
    own = labels_of_cells(flat, labels, (80, 80))
    parameters = PatchParameters(filled=1.0, varied=float(varied), diameters=(1.3, 6.0))
    moved_cells = 0
    for seed in range(6):
        rng = np.random.default_rng(seed)
        moved, found = insert_on_cells(cells, wanted_hazards(cells, parameters, rng, own), flat, rng, own)
        fixed = cells.covered & (own != 0)
        assert fixed.sum() > 300
        assert not moved[fixed].any()
        np.testing.assert_array_equal(found[fixed], own[fixed])
        assert (found[~cells.covered] == 255).all()
        free = cells.covered & (own == 0)
        assert (moved[free & (found == 1)] > 0.0).all()
        assert (moved[free & (found == 2)] < 0.0).all()
        assert not (np.abs(moved[free & (found == 0)]) > 0.15).any()
        moved_cells += np.count_nonzero(found[free])
    # Without labels the same ground takes as many on as much room.
    assert moved_cells / 6 > 0.05 * np.count_nonzero(free)


def test_labelled_ground_gets_hazards_at_the_rate_of_its_background() -> None:
    flat = flat_ground(40.0, 9.0)
    cells = cell_heights(flat, 0.5, np.zeros(2), (80, 80))
    own = labels_of_cells(flat, np.where(flat[:, 0] < 10.0, 0, 255).astype(np.uint8), (80, 80))
    parameters = PatchParameters(filled=1.0)
    part, whole = (
        np.mean([len(wanted_hazards(cells, parameters, np.random.default_rng(k), given)) for k in range(40)])
        for given in (own, None)
    )
    assert part / whole == pytest.approx(0.25, abs=0.05)
    nothing = np.ones_like(own)
    assert wanted_hazards(cells, parameters, np.random.default_rng(1), nothing) == []
    moved, found = insert_on_cells(cells, [], flat, np.random.default_rng(1), nothing)
    assert not moved.any()
    assert set(np.unique(found)) <= {1, 255}


def test_a_patch_of_labelled_ground_has_its_labels_and_reaches_over_the_rim() -> None:
    """Ground of 13 m, on patches of 16 m and their margins, whose bulges and hollows are labelled."""
    points = hill(20.0, density=12.0, side=13.0)
    up, down = (np.hypot(points[:, 0] - x, points[:, 1] - 6.0) < 2.0 for x in (3.5, 9.5))
    points[:, 2] += 1.0 * up - 1.0 * down
    labels = (up + 2 * down).astype(np.uint8)
    ground = Ground("own", points[::-1], 12.0, (1.0, 1.0001), labels=labels[::-1])
    seen = set()
    for seed in range(8):
        patch = draw_patch([ground], replace(PLAIN, side=32, filled=0.0), np.random.default_rng(seed))
        height = patch.channels[3]
        for one, sign in ((patch, 1.0), (patch.mirrored(upside_down=True), -1.0)):
            for label in (1, 2):
                inside = sign * height[one.labels == label]
                if len(inside) > 6:
                    assert np.median(inside) * (1 if label == 1 else -1) > 0.5
                    seen.add((label, sign))
        assert np.mean(patch.labels == 255) > 0.1
    assert seen == {(1, 1.0), (2, 1.0), (1, -1.0), (2, -1.0)}


@pytest.mark.parametrize("label", [1, 255])
def test_ground_without_any_background_gives_patches_without_other_hazards(label: int) -> None:
    points = hill(20.0, density=6.0, side=20.0)
    ground = Ground("all one", points, 6.0, labels=np.full(len(points), label, dtype=np.uint8))
    patch = draw_patch([ground], replace(PLAIN, side=32, filled=2.0), np.random.default_rng(3))
    assert set(np.unique(patch.labels)) == {label, 255}


def test_too_little_ground_is_refused() -> None:
    with pytest.raises(InputError, match="has 20 points"):
        Ground("tiny", np.zeros((20, 3)), 1.0)
    with pytest.raises(InputError, match="multiple of 16"):
        PatchParameters(side=50)
    with pytest.raises(InputError, match="two has 500 points and 3 labels; give as many"):
        Ground("two", np.zeros((500, 3)), 1.0, labels=np.zeros(3, dtype=np.uint8))
    sparse = Ground("sparse", hill(0.0, density=0.2), 0.2, scales=(1.0, 1.0001))
    with pytest.raises(InputError, match="No patch with enough points"):
        draw_patch([sparse], PatchParameters(side=32), np.random.default_rng(0))
