"""The ground of a zone and what surveys measured there, from drawn changes whose truth is known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from slopewatch.engine.series.tracking import Sighting, Track
from slopewatch.engine.series.zone_grounds import Ground, zone_grounds
from slopewatch.engine.series.zone_means import zone_means
from slopewatch.engine.statistics.variogram import VariogramModel
from slopewatch.engine.zones.volumes import CorrelationModel
from slopewatch.tests.builders.drawn_changes import drawn_change

SHAPE, CELL, SIGMA, REGISTRATION = (60, 70), 0.2, 0.02, 0.003
MODEL = CorrelationModel(REGISTRATION, VariogramModel(1.0))
DEPTH = 0.2


def bowl(depth: float = DEPTH) -> np.ndarray:
    """A bowl with half-axes of 2 and 1.6 m, in metres."""
    v, u = (np.indices(SHAPE) + 0.5) * CELL
    square = ((u - 7.0) / 2.0) ** 2 + ((v - 6.0) / 1.6) ** 2
    return -depth * np.maximum(1.0 - square, 0.0) ** 2


def step(depth: float = DEPTH) -> np.ndarray:
    """Ground of 3 by 2.4 m that sank as one."""
    v, u = (np.indices(SHAPE) + 0.5) * CELL
    return np.where((np.abs(u - 7.0) < 1.5) & (np.abs(v - 6.0) < 1.2), -depth, 0.0)


def surveys(truth: np.ndarray, seed: int, count: int = 3, share: float = 1.0) -> list:
    """Changes that all have the first survey's errors; ``share`` of the cells was measured."""
    rng = np.random.default_rng(seed)
    first = rng.normal(0, SIGMA / 2**0.5, SHAPE)
    changes = []
    for _ in range(count):
        dz = truth + rng.normal(0, SIGMA / 2**0.5, SHAPE) - first + rng.normal(0, REGISTRATION)
        dz[rng.random(SHAPE) > share] = np.nan
        changes.append(drawn_change(dz, SIGMA, CELL, registration=REGISTRATION))
    return changes


def track_of(change, survey: int = 1) -> Track:
    cells = np.flatnonzero(change.significant & (bowl() + step() < 0))
    return Track("S001", -1, (Sighting(survey, cells, "new"),), cells, "", "")


@pytest.mark.parametrize(("truth", "area"), [(bowl(), np.count_nonzero(bowl() < -0.1 * DEPTH)), (step(), 180)])
def test_the_ground_of_a_zone_is_what_moved(truth, area):
    ratios = []
    for seed in range(10):
        changes = surveys(truth, seed)
        (ground,) = zone_grounds([track_of(changes[0])], changes, 0.2)
        ratios.append(len(ground.cells) / area)
        assert truth.ravel()[ground.cells].sum() == pytest.approx(truth.sum(), rel=0.15)
    assert np.median(ratios) == pytest.approx(1.0, abs=0.2)


def test_the_ground_comes_from_the_survey_that_saw_most():
    small, large = surveys(0.2 * bowl(), 1)[0], surveys(bowl(), 2)[0]
    first, later = track_of(small, 1), track_of(large, 2)
    both = replace(first, sightings=(*first.sightings, *later.sightings), footprint=later.footprint)
    (ground,) = zone_grounds([both], [small, large], 0.2)
    (of_later,) = zone_grounds([later], [small, large], 0.2)
    assert np.array_equal(ground.cells, of_later.cells)


def test_volumes_do_not_lean_and_their_intervals_hold_where_half_was_not_measured():
    held, ratios = [], []
    for seed in range(40):
        changes = surveys(bowl(), seed, share=0.5)
        (ground,) = zone_grounds([track_of(changes[0])], changes, 0.2)
        (found,) = zone_means([ground], changes, [MODEL] * 3, 0.2)
        true = bowl().ravel()[ground.cells].sum() * CELL**2
        assert found.volume[1:] == pytest.approx(found.change[1:] * found.area)
        assert found.measured[2] < 0.7
        held += (np.abs(found.volume[1:] - true) <= 1.96 * found.volume_error[1:]).tolist()
        ratios.append(found.volume[2] / true)
    assert np.median(ratios) == pytest.approx(1.0, abs=0.04)
    assert 0.9 <= np.mean(held) <= 0.995


def test_what_a_survey_did_not_see_is_in_its_error():
    changes = surveys(bowl(), 3)
    ground = Ground(np.flatnonzero(bowl() < -0.02))
    half = changes[1].dz.copy()
    half[:, :35] = np.nan
    most = changes[2].dz.copy()
    most.ravel()[ground.cells[10:]] = np.nan
    changes = [changes[0], *(drawn_change(dz, SIGMA, CELL, registration=REGISTRATION) for dz in (half, most))]
    (found,) = zone_means([ground], changes, [MODEL] * 3, 0.2)
    true = bowl().ravel()[ground.cells].sum() * CELL**2
    assert abs(found.volume[1] - true) <= 1.96 * found.volume_error[1]
    assert found.measured[2] == pytest.approx(0.5, abs=0.03)
    assert found.volume_error[2] > 0.2 * abs(found.volume[2]) > found.volume_error[1]
    assert abs(found.volume[2] - true) <= 1.96 * found.volume_error[2]
    assert found.measured[3] == 0
    assert np.isnan(found.change[3])
    assert np.isnan(found.volume[3])
    uniform = [changes[0], replace(changes[0], uniform_dz=0.3), changes[0]]
    assert np.isnan(zone_means([ground], uniform, [MODEL] * 3, 0.2)[0].change[2])


def test_the_first_surveys_error_is_in_all_comparisons_once():
    changes = [replace(c, count_from=c.count_from * 3) for c in surveys(bowl(), 4)]
    ground = Ground(np.flatnonzero(bowl() < -0.02))
    (found,) = zone_means([ground], changes, [MODEL] * 3, 0.2)
    sampling = SIGMA**2 / len(ground.cells)
    assert found.variance[0] == pytest.approx(sampling / 4, rel=1e-6)  # three times the points of the others
    assert found.variance[1:] == pytest.approx([sampling * 3 / 4 + REGISTRATION**2] * 3, rel=1e-6)
    assert found.volume_error[1] == pytest.approx(found.area * (sampling + REGISTRATION**2) ** 0.5, rel=1e-6)


def test_a_further_survey_changes_no_earlier_figure_of_the_same_ground():
    changes = surveys(bowl(), 5, count=4)
    ground = Ground(np.flatnonzero(bowl() < -0.02))
    before, after = (zone_means([ground], changes[:n], [MODEL] * n, 0.2)[0] for n in (3, 4))
    for name in ("change", "volume", "volume_error", "measured", "lowered", "raised"):
        np.testing.assert_array_equal(getattr(after, name)[:4], getattr(before, name))
