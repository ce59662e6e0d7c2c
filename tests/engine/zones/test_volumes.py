"""Volumes against changes that are known, errors against the spread over many simulated measurements."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from scipy import ndimage
from slopewatch.engine.grid.partition import Partition
from slopewatch.engine.statistics.normal import Z95
from slopewatch.engine.statistics.variogram import VariogramModel
from slopewatch.engine.zones.footprints import Cells, footprint_labels, outline_footprints
from slopewatch.engine.zones.groups import label_groups
from slopewatch.engine.zones.volumes import CorrelationModel, fit_correlation, outside, zone_volumes
from slopewatch.interface.parameters import ZoneParameters
from slopewatch.tests.builders.change_zones import single

CELL = 0.1
INDEPENDENT = CorrelationModel(0.0, VariogramModel(1.0))


def cells_of(dz: np.ndarray, error: np.ndarray | float, block: np.ndarray | None = None) -> Cells:
    error = np.where(np.isfinite(dz), error, np.nan)
    partition = single(dz, CELL) if block is None else Partition.of_blocks(block, CELL)
    return Cells(dz, error, np.full(dz.shape, CELL**2), partition)


def bowl(shape: tuple[int, int], middle: tuple[float, float], radius: float, depth: float) -> np.ndarray:
    """A smooth hollow of ``radius`` cells; its volume is pi / 3 radius² depth in cells."""
    rows, columns = np.indices(shape)
    square = ((rows - middle[0]) ** 2 + (columns - middle[1]) ** 2) / radius**2
    return -depth * np.maximum(1 - square, 0) ** 2


def smooth_noise(shape: tuple[int, int], reach: int, random: np.random.Generator) -> np.ndarray:
    """Noise of variance 1 whose squares of ``reach`` cells share what they have."""
    white = random.normal(size=(shape[0] + reach - 1, shape[1] + reach - 1))
    sums = np.zeros(shape)
    for i, j in itertools.product(range(reach), repeat=2):
        sums += white[i : i + shape[0], j : j + shape[1]]
    return sums / reach


def labelled(dz: np.ndarray, error: np.ndarray | float) -> tuple[np.ndarray, int]:
    significant = np.nan_to_num(np.abs(dz)) > 1.96 * error
    labels = label_groups(dz, significant, ZoneParameters(), single(dz, CELL))
    return labels, int(labels.max())


def test_a_footprint_reaches_to_where_the_change_ends() -> None:
    """The zone holds what lies beyond the level; the volume is all of the hollow's."""
    dz = bowl((90, 90), (45, 45), 20.0, 0.2)
    labels, count = labelled(dz, 0.05)
    assert count == 1
    own = -dz[labels == 1].sum()
    known = np.pi / 3 * 20.0**2 * 0.2
    assert own < 0.8 * known
    (footprint,) = outline_footprints(cells_of(dz, 0.05), labels, 1, gap=0.2)
    found = zone_volumes((footprint,), cells_of(dz, 0.05), INDEPENDENT)
    assert -found.net[0] == pytest.approx(known * CELL**2, rel=0.01)
    # the hollow of 20 cells and not much more
    assert np.pi * 18**2 < footprint.inside.sum() < np.pi * 25**2


def test_a_shift_of_everything_does_not_widen_a_footprint() -> None:
    dz = bowl((90, 90), (45, 45), 15.0, 0.4) - 0.004
    labels, _ = labelled(dz, 0.05)
    areas = [
        outline_footprints(cells_of(dz, 0.05), labels, 1, gap=0.2, registration_error=r)[0].inside.sum()
        for r in (0.0, 0.005)
    ]
    assert areas[1] < np.pi * 18**2 < 0.9 * areas[0]


def test_gaps_take_after_the_cells_around_them() -> None:
    random = np.random.default_rng(1)
    whole = bowl((90, 90), (45, 45), 25.0, 0.5)
    dz = np.where(random.random(whole.shape) < 0.5, np.nan, whole)
    dz[40:50, 40:50] = np.nan  # nothing is known of its middle
    labels, count = labelled(dz, 0.02)
    assert count == 1
    cells = cells_of(dz, 0.02)
    (footprint,) = outline_footprints(cells, labels, 1, gap=0.2)
    found = zone_volumes((footprint,), cells, INDEPENDENT)
    told = np.zeros(dz.shape, dtype=bool)
    told[footprint.window] = footprint.inside
    assert not told[44:46, 44:46].any()
    assert found.net[0] == pytest.approx(whole[told].sum() * CELL**2, abs=Z95 * found.error[0])
    assert found.measured[0] == pytest.approx(np.isfinite(dz[told]).mean())
    assert found.area[0] == pytest.approx(told.sum() * CELL**2)
    # a smooth surface is told well
    assert footprint.scatter < 0.02 * abs(found.net[0])


def test_a_grown_cell_across_the_edge_of_a_footprint_widens_its_error() -> None:
    """Two of its four rows are within the footprint; its change may be all within or all outside."""
    dz = np.full((40, 40), -0.05)
    dz[10:20, 10:20] = 0.5
    block = np.arange(dz.size).reshape(dz.shape)
    block[20:24, 12:16], dz[20:24, 12:16] = block[20, 12], 0.1
    labels, _ = labelled(dz, 0.06)
    scatter = [outline_footprints(cells_of(dz, 0.06, b), labels, 1, gap=0.2)[0].scatter for b in (None, block)]
    assert scatter[0] == 0.0
    within = outline_footprints(cells_of(dz, 0.06, block), labels, 1, gap=0.2)[0]
    inside = np.zeros(dz.shape, dtype=bool)
    inside[within.window] = within.inside
    assert 0 < inside[20:24, 12:16].sum() < 16
    random = np.random.default_rng(3)
    drawn = random.uniform(0.0, 0.1 * 16 * CELL**2, 100_000)
    assert scatter[1] == pytest.approx(drawn.std(), rel=0.02)


def test_nothing_is_told_outside_of_the_survey() -> None:
    dz = np.full((60, 60), np.nan)
    dz[5:40, 10:50] = -0.4
    dz[20, 30] = np.nan
    labels, _ = labelled(dz, 0.02)
    (footprint,) = outline_footprints(cells_of(dz, 0.02), labels, 1, gap=0.2)
    assert footprint.inside.sum() == 35 * 40
    assert footprint.weights.sum() == pytest.approx(35 * 40 * CELL**2)


def test_footprints_share_no_cell_and_leave_other_zones_alone() -> None:
    dz = bowl((80, 120), (40, 40), 18.0, 0.4) - bowl((80, 120), (40, 76), 18.0, 0.4)
    labels, count = labelled(dz, 0.03)
    assert count == 2
    footprints = outline_footprints(cells_of(dz, 0.03), labels, 2, gap=0.2)
    taken = np.zeros(dz.shape, dtype=int)
    for footprint in footprints:
        taken[footprint.window] += footprint.inside
    assert taken.max() == 1
    named = footprint_labels(footprints, dz.shape)
    np.testing.assert_array_equal(named[labels > 0], labels[labels > 0])
    net = zone_volumes(footprints, cells_of(dz, 0.03), INDEPENDENT).net
    assert net[0] == pytest.approx(-net[1], rel=0.02)
    assert not outside(footprints, np.ones(dz.shape, dtype=bool), CELL)[named > 0].any()


@pytest.mark.parametrize("reach", [1, 6])
def test_the_error_is_the_spread_over_many_measurements(reach: int) -> None:
    """One footprint, many measurements with correlated errors; the model is taken from a survey without change."""
    random = np.random.default_rng(2)
    truth = bowl((60, 60), (30, 30), 14.0, 0.6)
    sampling = random.uniform(0.02, 0.08, truth.shape)
    registration = 0.004
    error = np.hypot(sampling, registration)
    still = random.uniform(0.02, 0.08, (300, 300))
    noise = cells_of(still * smooth_noise(still.shape, reach, random), np.hypot(still, registration))
    model = fit_correlation(noise, np.ones(still.shape, dtype=bool), registration)
    labels, count = labelled(truth, 0.05)
    footprints = outline_footprints(cells_of(truth, error), labels, count, gap=0.2)
    stated = zone_volumes(footprints, cells_of(truth, error), model)
    volumes, means = [], []
    for _ in range(1500):
        dz = truth + sampling * smooth_noise(truth.shape, reach, random) + random.normal(0, registration)
        measured = zone_volumes(footprints, cells_of(dz, error), INDEPENDENT)
        volumes.append(measured.net[0])
        means.append(dz[labels == 1].mean())
    assert stated.error[0] == pytest.approx(np.std(volumes), rel=0.1)
    assert stated.mean_error[0] == pytest.approx(np.std(means), rel=0.1)
    assert stated.lowering == pytest.approx((stated.net[0], stated.error[0]))
    assert stated.raising == (0.0, 0.0)


def test_cells_that_are_one_err_as_one() -> None:
    random = np.random.default_rng(3)
    block = np.arange(225).reshape(15, 15).repeat(4, axis=0).repeat(4, axis=1)
    block[:, :8] = -1
    error = random.uniform(0.02, 0.1, 225).reshape(15, 15).repeat(4, axis=0).repeat(4, axis=1)
    dz = np.zeros((60, 60))
    dz[12:48, 4:48] = 1.0
    labels, count = labelled(dz, error)
    assert count == 1
    footprints = outline_footprints(cells_of(dz, error, block), labels, 1, gap=0.2)
    stated = zone_volumes(footprints, cells_of(dz, error, block), INDEPENDENT)
    weights = np.zeros(dz.shape)
    weights[footprints[0].window] = footprints[0].weights
    sums = []
    for _ in range(3000):
        of_block = random.normal(size=225)[np.maximum(block, 0)]
        noise = np.where(block >= 0, of_block, random.normal(size=dz.shape))
        sums.append(np.sum(weights * error * noise))
    assert stated.error[0] == pytest.approx(np.std(sums), rel=0.06)


def test_without_stable_ground_errors_count_as_fully_correlated() -> None:
    dz = bowl((60, 60), (30, 30), 14.0, 0.6)
    cells = cells_of(dz, np.hypot(0.03, 0.004))
    model = fit_correlation(cells, np.zeros(dz.shape, dtype=bool), 0.004)
    assert model.variogram is None
    assert "fully correlated" in model.name
    labels, _ = labelled(dz, 0.03)
    found = zone_volumes(outline_footprints(cells, labels, 1, gap=0.2), cells, model)
    assert found.error[0] == pytest.approx(np.hypot(0.03, 0.004) * found.area[0])
    assert found.samples[0] == 1.0


def test_no_zone_has_no_volume() -> None:
    dz = np.zeros((30, 30))
    found = zone_volumes((), cells_of(dz, 0.05), INDEPENDENT)
    assert found.net.shape == (0,)
    assert found.total == found.lowering == found.raising == (0.0, 0.0)


@pytest.mark.parametrize("reach", [1, 4])
def test_the_interval_covers_the_truth_where_zones_are_found_by_their_noise(reach: int) -> None:
    """Zones and volumes from one measurement: sums over the zones' own cells lean outward, footprints do not."""
    random = np.random.default_rng(4)
    shape = (240, 240)
    truth = np.zeros(shape)
    for row, column in itertools.product((40, 120, 200), repeat=2):
        depth = random.uniform(0.1, 0.4) * random.choice((-1, 1))
        truth += bowl(shape, (row, column), random.uniform(8, 22), depth)
    covered, leaning, relative = [], [], []
    for _ in range(12):
        noise = smooth_noise(shape, reach, random) * np.sqrt(0.4) + random.normal(size=shape) * np.sqrt(0.6)
        registration = random.normal(0, 0.003)
        dz = truth + 0.04 * noise + registration
        dz[ndimage.gaussian_filter(random.normal(size=shape), 1) > 0.2] = np.nan
        error = np.hypot(0.04, 0.003)
        cells = cells_of(dz, error)
        labels, count = labelled(dz, error)
        footprints = outline_footprints(cells, labels, count, gap=0.2, registration_error=0.003)
        model = fit_correlation(cells, outside(footprints, np.isfinite(dz), CELL), 0.003)
        found = zone_volumes(footprints, cells, model)
        named = footprint_labels(footprints, shape)
        for zone in range(1, count + 1):
            true = truth[named == zone].sum() * CELL**2
            covered.append(abs(found.net[zone - 1] - true) <= Z95 * found.error[zone - 1])
            own = labels == zone
            leaning.append(dz[own].sum() / truth[own].sum() - 1)
            relative.append(found.net[zone - 1] / true - 1)
    assert len(covered) > 60
    assert 0.9 <= np.mean(covered) <= 1.0
    assert np.median(leaning) > 0.05
    assert abs(np.median(relative)) < 0.03


def test_stable_cells_without_distances_for_a_variogram_count_as_fully_correlated() -> None:
    """Values along one line, apart: no pair of them is as near as the line is wide."""
    dz = np.full((2, 6000), np.nan)
    dz[0, ::10] = np.random.default_rng(3).normal(0, 0.02, 600)
    cells = cells_of(dz, 0.02)
    model = fit_correlation(cells, np.isfinite(dz), 0.0)
    assert model.variogram is None
    assert model.cells == 600
    assert "too few distances" in model.name
    assert model.sum_error(np.isfinite(dz).astype(float), cells) == pytest.approx(600 * 0.02)
