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
        flat = cut(Ground("hill", points, 8.0, scales=(1.0, 1.0001)), PLAIN, np.random.default_rng(seed))
        assert flat is not None
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

    assert density(half) / density(whole) == pytest.approx(4.0, rel=0.15)
    assert half[:, 2].std() / whole[:, 2].std() == pytest.approx(0.5, rel=0.1)


def test_points_are_thinned_to_the_density_drawn() -> None:
    ground = Ground("hill", hill(0.0), 8.0, scales=(1.0, 1.0001))
    flat = cut(ground, replace(PLAIN, densities=(2.0, 2.0001)), np.random.default_rng(1))
    assert flat is not None
    cells = np.unique(np.floor(flat[:, :2] / 4), axis=0, return_counts=True)[1]
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
    points = cut(ground, PLAIN, np.random.default_rng(1))
    assert points is not None
    cells = cell_heights(points, 0.5, np.zeros(2), (64, 64))
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


def test_too_little_ground_is_refused() -> None:
    with pytest.raises(InputError, match="has 20 points"):
        Ground("tiny", np.zeros((20, 3)), 1.0)
    with pytest.raises(InputError, match="multiple of 16"):
        PatchParameters(side=50)
    sparse = Ground("sparse", hill(0.0, density=0.2), 0.2, scales=(1.0, 1.0001))
    with pytest.raises(InputError, match="No patch with enough points"):
        draw_patch([sparse], PatchParameters(side=32), np.random.default_rng(0))
