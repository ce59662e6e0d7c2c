"""Flight strips that do not fit: found, fitted where that holds, left alone where they fit; change is not absorbed."""

from __future__ import annotations

from pathlib import Path

import laspy
import numpy as np
import pytest
from pyproj import CRS
from slopewatch.engine.ground.strips import correction
from slopewatch.engine.ground.strips.correction import copy_fitted, fit_strips, strips_sentence
from slopewatch.engine.ground.strips.overlaps import Moments, StripPoints
from slopewatch.tests.builders.moving_ground import RUN_M, SLOPE, bare_slope

SHIFT = np.array([0.06, -0.04, 0.05])
DRIFT_M, NOISE_M, SECONDS = 0.03, 0.01, 120.0
POINTS = 40_000


@pytest.fixture(scope="module")
def ground():
    return bare_slope()


def strips(ground, seed: int = 1, sources: int = 2) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points (n, 3) of strips that lie side by side and overlap widely, their numbers, and their times (n,)."""
    rng = np.random.default_rng(seed)
    found = []
    for number in range(sources):
        low = 0.2 * RUN_M * number / (sources - 1)
        high = low + 0.8 * RUN_M
        u, v = rng.uniform(SLOPE[0], SLOPE[2], POINTS), rng.uniform(low, high, POINTS)
        along = (u - SLOPE[0]) / (SLOPE[2] - SLOPE[0])
        seconds = SECONDS * (number + np.where(number % 2, 1 - along, along)) + 100.0 * number
        z = ground.height(u, v) + rng.normal(0, NOISE_M, POINTS)
        found.append((np.column_stack([u, v, z]), np.full(POINTS, number + 7), seconds))
    return tuple(np.concatenate(part) for part in zip(*found, strict=True))


def drift(seconds: np.ndarray) -> np.ndarray:
    """A slow curve over the flight, m."""
    return DRIFT_M * np.sin(2 * np.pi * (seconds - seconds.min()) / np.ptp(seconds))


def write(path: Path, xyz: np.ndarray, source: np.ndarray, seconds: np.ndarray) -> Path:
    header = laspy.LasHeader(point_format=7, version="1.4")
    header.scales, header.offsets = [0.0001] * 3, [500_000.0, 3_500_000.0, 0.0]
    header.add_crs(CRS.from_epsg(32651))
    las = laspy.LasData(header)
    las.x, las.y, las.z = (xyz + [500_000.0, 3_500_000.0, 100.0]).T
    las.point_source_id, las.gps_time = source, seconds
    las.intensity = np.arange(len(xyz)) % 60_000
    las.classification = np.full(len(xyz), 2)
    las.write(path)
    return path


def test_offset_and_drift_are_found_and_taken_off(ground, tmp_path):
    xyz, source, seconds = strips(ground)
    bad = xyz + SHIFT * (source == 8)[:, None]
    bad[:, 2] += drift(seconds)
    path = write(tmp_path / "bad.laz", bad, source, seconds)
    fitted = fit_strips(path)
    fit = fitted.fit
    assert fit.level == "drift"
    assert fit.before > 0.04
    assert fit.after < 0.005
    found = fit.model.shift[1] - fit.model.shift[0]
    # An even face fixes shifts only by its relief.
    assert found[:2] == pytest.approx(SHIFT[:2], abs=0.02)
    copy_fitted(path, tmp_path / "fitted.laz", fitted)
    las = laspy.read(tmp_path / "fitted.laz")
    after = np.column_stack([las.x, las.y, las.z]) - [500_000.0, 3_500_000.0, 100.0]
    # Against the true ground, which the fit has not seen: one rest that all have in common, and no step.
    left = after[:, 2] - ground.height(after[:, 0], after[:, 1])
    raw = bad[:, 2] - ground.height(bad[:, 0], bad[:, 1])
    means = [[values[source == k].mean() for k in (7, 8)] for values in (raw, left)]
    assert abs(np.subtract(*means[0])) > 0.035
    assert abs(np.subtract(*means[1])) < 0.006
    assert left.std() < 0.5 * raw.std()
    # All that a point has but its place is as it was.
    assert np.array_equal(las.intensity, np.arange(len(xyz)) % 60_000)
    assert np.array_equal(las.point_source_id, source)
    assert np.asarray(las.gps_time) == pytest.approx(seconds)
    assert "which leaves" in strips_sentence(fit, "bad.laz")
    again = fit_strips(tmp_path / "fitted.laz").fit
    assert again.level == ""
    assert again.before < 0.006


@pytest.mark.parametrize("seed", range(4))
def test_strips_that_fit_stay(ground, tmp_path, seed):
    fit = fit_strips(write(tmp_path / "good.laz", *strips(ground, seed, 3))).fit
    assert fit.level == ""
    assert fit.model is None
    assert fit.after == fit.before < 0.006
    assert strips_sentence(fit, "good.laz") == ""
    assert fit.facts()["correction"] == "none"


def test_change_between_surveys_is_not_absorbed(ground, tmp_path):
    """The later survey of ground that sank and rose as a whole: the same correction as of the earlier one."""
    xyz, source, seconds = strips(ground)
    bad = xyz + SHIFT * (source == 8)[:, None]
    middle = np.array([12.0, RUN_M / 2])
    away = np.hypot(*(xyz[:, :2] - middle).T)
    changed = bad - np.array([0, 0, 0.4]) * np.where(away < 6, np.cos(np.pi * away / 12) ** 2, 0)[:, None]
    changed[:, 2] += 0.2
    moved = [fit_strips(write(tmp_path / f"{k}.laz", c, source, seconds)).fit for k, c in enumerate((bad, changed))]
    left = []
    for fit, cloud in zip(moved, (bad, changed), strict=True):
        corrected = cloud - fit.model.correction((source - 7).astype(int), seconds)
        left.append(corrected[:, 2] - ground.height(corrected[:, 0], corrected[:, 1]))
    found, put_in = left[1] - left[0], (changed - bad)[:, 2]
    for part in (away > 7, away < 3):
        for strip in (7, 8):
            here = part & (source == strip)
            assert found[here].mean() == pytest.approx(put_in[here].mean(), abs=0.008)
    assert put_in[away < 3].mean() < -0.08


def test_mean_of_all_strips_stays_where_it_was(ground, tmp_path):
    xyz, source, seconds = strips(ground, 5, 3)
    bad = xyz + SHIFT * (source == 9)[:, None]
    fit = fit_strips(write(tmp_path / "bad.laz", bad, source, seconds)).fit
    weights = np.array(fit.points)
    assert weights @ fit.model.shift == pytest.approx(np.zeros(3), abs=1e-6 * weights.sum())


def test_strips_without_numbers_are_parted_by_pauses(ground, tmp_path):
    xyz, source, seconds = strips(ground)
    bad = xyz + SHIFT * (source == 8)[:, None]
    fit = fit_strips(write(tmp_path / "bad.laz", bad, np.zeros(len(xyz), int), seconds)).fit
    assert fit.strips == (1, 2)
    assert fit.points == (POINTS, POINTS)
    assert fit.level
    assert fit.after < 0.006 < fit.before


def test_one_strip_or_too_little_overlap_is_not_compared(ground, tmp_path):
    xyz, source, seconds = strips(ground)
    one = source == 7
    assert fit_strips(write(tmp_path / "one.laz", xyz[one], source[one], seconds[one])) is None
    apart = xyz + np.where(one, 0.0, 100.0)[:, None] * [0, 1, 0]
    assert fit_strips(write(tmp_path / "apart.laz", apart, source, seconds)) is None


def test_disagreement_that_no_correction_explains_is_told_and_left(ground, tmp_path):
    """Noise of a long wave in one strip: no shift and no curve over time takes it away."""
    xyz, source, seconds = strips(ground)
    wave = 0.08 * np.sin(2 * np.pi * xyz[:, 0] / 9.0) * np.sin(2 * np.pi * xyz[:, 1] / 9.0)
    bad = xyz + np.array([0, 0, 1.0]) * (wave * (source == 8))[:, None]
    fit = fit_strips(write(tmp_path / "bad.laz", bad, source, seconds)).fit
    assert fit.before > correction.WORTH_TELLING_M
    assert fit.model is None
    assert "stay as surveyed" in strips_sentence(fit, "bad.laz")


def test_heights_over_a_cell_are_those_of_planes_through_its_points():
    """The moments give the same as a least-squares fit of every cell's own points."""
    rng = np.random.default_rng(2)
    xyz = np.column_stack([rng.uniform(0, 4, (4000, 2)), rng.normal(0, 0.01, 4000)])
    xyz[:, 2] += 0.3 * xyz[:, 0] - 0.2 * xyz[:, 1] + 10
    strip = rng.integers(0, 3, 4000)
    xyz[:, 2] += 0.1 * strip
    seconds = rng.uniform(0, 50, 4000)
    moments = Moments(1.0, np.zeros(3), 6, 3)
    for part in (slice(0, 1500), slice(1500, 4000)):
        moments.add(StripPoints(xyz[part], strip[part], seconds[part]))
    pairs = moments.overlaps()
    assert len(pairs) == 16 * 3
    for row in range(0, len(pairs), 7):
        inside = (np.abs(xyz[:, :2] - pairs.place[row]) < 0.5).all(axis=1)
        design = np.column_stack([xyz[inside, :2] - pairs.place[row], np.eye(3)[strip[inside]]])
        solution = np.linalg.lstsq(design, xyz[inside, 2], rcond=None)[0]
        assert pairs.gradient[row] == pytest.approx(solution[:2], abs=1e-6)
        assert pairs.height[row] == pytest.approx(
            solution[2 + pairs.first[row]] - solution[2 + pairs.second[row]], abs=1e-6
        )
        times = [seconds[inside & (strip == k[row])].mean() for k in (pairs.first, pairs.second)]
        assert pairs.seconds[row] == pytest.approx(times)
