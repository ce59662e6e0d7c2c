"""The model of errors by slope against scatter that was put in."""

from __future__ import annotations

import numpy as np
import pytest
from slopewatch.engine.change.slope_calibration import Samples, calibrate, patch_halves, uncalibrated
from slopewatch.engine.statistics.layout import Layout

SHAPE = (200, 300)
EVERYWHERE = np.ones(SHAPE, dtype=bool)


def truth(slope: np.ndarray) -> np.ndarray:
    """Factor by which the errors are too small (too large where it is flat)."""
    return np.interp(slope, [0, 20, 60], [0.7, 1.0, 2.2])


def field(seed: int, *, degrees: float = np.inf, shape: tuple[int, int] = SHAPE) -> tuple[np.ndarray, ...]:
    """dz, its stated error and the slope; Student's t with ``degrees`` of freedom, of the stated error's size."""
    rng = np.random.default_rng(seed)
    slope = rng.uniform(0, 60, shape)
    error = rng.uniform(0.005, 0.05, shape)
    noise = rng.normal(0, 1, shape) if np.isinf(degrees) else rng.standard_t(degrees, shape)
    return noise * error * truth(slope), error, slope


def beyond(dz: np.ndarray, error: np.ndarray, slope: np.ndarray, model, registration: float = 0.0) -> list[float]:
    """Share of cells beyond the 95 % level in classes of 15 degrees."""
    level = 1.959964 * np.hypot(model.factor(slope) * error, registration)
    classes = [(slope >= low) & (slope < low + 15) for low in (0, 15, 30, 45)]
    return [float((np.abs(dz) > level)[c].mean()) for c in classes]


@pytest.mark.parametrize("degrees", [np.inf, 4, 2.5])
def test_other_surveys_with_the_same_errors_keep_their_level_in_every_class(degrees):
    """Calibrated on one pair, measured on another; with tails as heavy as real ground's."""
    model = calibrate(Samples(*field(1, degrees=degrees), EVERYWHERE), registration_error=0.0, confidence=0.95)
    other = field(2, degrees=degrees)
    assert all(0.04 <= share <= 0.06 for share in beyond(*other, model))
    wrong = beyond(*other, uncalibrated())
    assert max(wrong) > 0.15, "the errors need the calibration"


def test_normal_errors_give_back_the_factor_that_was_put_in():
    model = calibrate(Samples(*field(3), EVERYWHERE), registration_error=0.0, confidence=0.95)
    slope = np.linspace(3, 57, 50)
    assert np.allclose(model.factor(slope), truth(slope), rtol=0.06)
    assert all(c.exceedance == pytest.approx(0.05, abs=0.006) for c in model.classes)
    assert sum(c.cells for c in model.classes) == model.stable_cells == EVERYWHERE.sum()


def test_the_registrations_part_is_not_counted_twice():
    dz, error, slope = field(4)
    dz = dz + 0.02  # a bias of one registration error
    model = calibrate(Samples(dz, error, slope, EVERYWHERE), registration_error=0.02, confidence=0.95)
    assert all(0.045 <= share <= 0.055 for share in beyond(dz, error, slope, model, 0.02))


def test_only_stable_cells_count():
    dz, error, slope = field(5)
    moved = np.random.default_rng(1).random(SHAPE) < 0.3
    model = calibrate(Samples(dz - 0.5 * moved, error, slope, ~moved), registration_error=0.0, confidence=0.95)
    assert all(0.04 <= share <= 0.06 for share in beyond(dz, error, slope, model))


def test_few_cells_are_joined_and_narrow_with_care():
    """Levels from 300 cells of surveys that are better than they say: rarely too narrow."""
    shares = []
    for seed in range(20):
        dz, error, slope = field(100 + seed, shape=(15, 20))
        everywhere = np.ones((15, 20), dtype=bool)
        model = calibrate(
            Samples(0.6 * dz / truth(slope), error, slope, everywhere), registration_error=0.0, confidence=0.95
        )
        assert len(model.classes) == 1
        assert model.factor(slope).max() <= 1.0
        other, error, slope = field(seed)
        shares.append(float((0.6 * np.abs(other) / truth(slope) > 1.96 * model.factor(slope) * error).mean()))
    assert np.mean(shares) < 0.04
    assert np.quantile(shares, 0.9) < 0.06


def test_too_few_stable_cells_widen_the_level_and_say_so():
    dz, error, slope = field(7)
    few = np.zeros(SHAPE, dtype=bool)
    few[0, :40] = True
    model = calibrate(Samples(dz, error, slope, few), registration_error=0.0, confidence=0.95)
    assert (model.kind, model.classes) == ("widened", ())
    assert (model.factor(slope) == 1.5).all()
    assert "only 40 cells" in model.notes[0]
    assert "known to be stable" in model.notes[0]


def test_stable_ground_that_has_moved_as_a_whole_is_none():
    dz, error, slope = field(8)
    model = calibrate(Samples(dz + 0.4, error, slope, EVERYWHERE), registration_error=0.01, confidence=0.95)
    assert model.kind == "widened"
    assert "+0.40" in model.notes[0]


def test_what_scatters_more_than_points_explain_is_named():
    dz, error, slope = field(9)
    model = calibrate(Samples(3 * dz, error, slope, EVERYWHERE), registration_error=0.0, confidence=0.95)
    assert "check the registration" in model.notes[0]


def test_an_unknown_slope_gets_the_typical_factor():
    model = calibrate(Samples(*field(10), EVERYWHERE), registration_error=0.0, confidence=0.95)
    assert model.factor(np.array([np.nan]))[0] == model.typical


def test_errors_are_made_smaller_only_where_both_halves_of_the_ground_say_so():
    """Half of the patches have the errors that their points say, the others half of them."""
    random = np.random.default_rng(5)
    half = patch_halves(Layout((100, 100)), np.arange(10_000)).reshape(100, 100)
    assert 0.4 < half.mean() < 0.6
    one, slope = np.ones(half.shape), np.full(half.shape, 20.0)
    common = {"registration_error": 0.0, "confidence": 0.95}
    everywhere = half | True
    dz = random.normal(size=half.shape) * np.where(half, 1.0, 0.5)
    quiet = random.normal(size=half.shape) * 0.5
    assert calibrate(Samples(dz, one, slope, everywhere), **common).typical < 0.9
    (told,) = calibrate(Samples(dz, one, slope, everywhere, half=half), **common).classes
    assert np.mean(np.abs(dz[half]) > 1.96 * told.factor) < 0.07
    assert told.factor == pytest.approx(1.0, abs=0.06)
    (same,) = calibrate(Samples(quiet, one, slope, everywhere, half=half), **common).classes
    assert same.factor == pytest.approx(0.5, abs=0.03), "what all patches say"
    (few,) = calibrate(Samples(quiet, one, slope, everywhere, half=np.ones(half.shape, dtype=bool)), **common).classes
    assert few.factor == 1.0, "without a second half there is no evidence"


def test_cells_that_share_points_count_as_fewer():
    """Each of 300 errors in five cells: no surer than 300 cells, though their number is that of 1,500."""
    random = np.random.default_rng(30)
    common = {"registration_error": 0.0, "confidence": 0.95}
    wider = []
    for _ in range(20):
        dz, half = random.normal(size=300) * 0.7, random.random(300) < 0.5
        cells = dz, np.ones(300), np.full(300, 20.0), np.ones(300, bool)
        arguments = [np.repeat(values, 5) for values in cells]
        expected = calibrate(Samples(*cells, half=half), **common).typical
        shared = calibrate(Samples(*arguments, half=np.repeat(half, 5)), independent=0.2, **common).typical
        assert shared == pytest.approx(expected, rel=0.02)
        wider.append(shared - calibrate(Samples(*arguments, half=np.repeat(half, 5)), **common).typical)
    assert np.mean(wider) > 0.02
    few = np.arange(1500) < 200
    assert calibrate(Samples(*arguments[:3], few), **common).kind == "calibrated"
    told = calibrate(Samples(*arguments[:3], few), independent=0.2, **common)
    assert told.kind == "widened"
    assert "only 200 cells" in told.why
