"""What is decided of a survey read in parts, against the functions that have all points in memory."""

from __future__ import annotations

import laspy
import numpy as np
import pytest
from slopewatch.engine.geometry.dominant_plane import apply_matrix, flattening_matrix
from slopewatch.engine.geometry.point_spacing import point_spacing
from slopewatch.engine.ground.filtering import dominant_plane
from slopewatch.engine.ground.metrics import coverage
from slopewatch.engine.ground.outliers import outliers
from slopewatch.engine.ground.tiles import survey as module
from slopewatch.engine.ground.tiles.survey import look_at_kept, look_through
from slopewatch.engine.pointcloud.returns import ReturnCounts, last_returns, returns_of
from slopewatch.interface.parameters import GroundParameters
from slopewatch.tests.builders.long_slope import slope_points


@pytest.fixture(scope="module")
def cloud(tmp_path_factory):
    """Written uncompressed, in several groups of the reader."""
    path = tmp_path_factory.mktemp("cloud") / "c.las"
    las = laspy.LasData(laspy.LasHeader(point_format=6, version="1.4"))
    las.header.scales, las.header.offsets = [0.001] * 3, [0, 0, 0]
    xyz = slope_points(400_000)
    las.x, las.y, las.z = xyz.T
    rng = np.random.default_rng(1)
    las.number_of_returns = rng.integers(1, 4, len(xyz))
    las.return_number = np.minimum(rng.integers(1, 4, len(xyz)), las.number_of_returns)
    las.classification = np.where(rng.random(len(xyz)) < 1e-4, 7, 1)
    las.write(path)
    return path


def test_plane_and_outliers_are_those_of_all_points(cloud):
    las, parameters = laspy.read(cloud), GroundParameters()
    xyz = np.array(las.xyz)
    found = look_through(cloud, parameters, flags_in_class=False)
    assert len(list(found.parts())) >= 2
    plane = dominant_plane(xyz)
    assert np.array_equal(found.plane.normal, plane.normal)
    assert np.array_equal(found.plane.centroid, plane.centroid)
    flat = apply_matrix(flattening_matrix(plane), xyz)
    expected = outliers(flat, parameters.denoise_radius, parameters.denoise_group) | (las.classification == 7)
    labels = np.asarray(las.classification)
    assert np.array_equal(found.denoising.outliers(flat, labels), expected)
    assert expected.sum() > 5
    kept = look_at_kept(found, parameters)
    assert (kept.count, len(kept.removed)) == (np.count_nonzero(~expected), np.count_nonzero(expected))
    assert kept.area == coverage(xyz[~expected])
    assert kept.spacing == pytest.approx(point_spacing(xyz[~expected]), rel=0.02)
    assert kept.flat_spacing == pytest.approx(point_spacing(flat[~expected]), rel=0.02)
    assert kept.flat_low == pytest.approx(flat[~expected, :2].min(axis=0), abs=1e-9)
    assert kept.flat_size == pytest.approx(np.ptp(flat[~expected, :2], axis=0), abs=1e-9)
    assert not GroundParameters(denoise=False).denoise
    whole = look_through(cloud, GroundParameters(denoise=False), flags_in_class=False)
    assert not whole.denoising.outliers(flat, labels).any()


def test_a_sample_for_medians_hardly_moves_the_decisions(cloud, monkeypatch):
    las, parameters = laspy.read(cloud), GroundParameters()
    monkeypatch.setattr(module, "MAX_SAMPLE", 5_000)
    found = look_through(cloud, parameters, flags_in_class=False)
    flat = found.flat(np.array(las.xyz))
    expected = outliers(flat, parameters.denoise_radius, parameters.denoise_group) | (las.classification == 7)
    different = found.denoising.outliers(flat, np.asarray(las.classification)) != expected
    assert np.count_nonzero(different) <= 0.1 * np.count_nonzero(expected)


@pytest.mark.parametrize(
    ("number", "total"),
    [
        ([1, 2, 1, 1], [2, 2, 1, 1]),
        ([0, 0, 0], [0, 0, 0]),
        ([0, 0, 0], [1, 1, 1]),
        ([1, 0, 1], [1, 1, 1]),
        ([1, 1, 1, 1], [2, 2, 2, 1]),
    ],
)
def test_return_numbers_counted_in_parts_are_judged_as_together(number, total):
    numbers, totals = (np.array(values, dtype=np.uint8) for values in (number, total))
    together = last_returns(numbers, totals)
    counts = ReturnCounts()
    for part in (slice(0, 1), slice(1, None)):
        counts = counts.with_more(numbers[part], totals[part])
    found = returns_of(counts)
    facts = ("usable", "mixed", "note", "lost")
    assert [getattr(found, f) for f in facts] == [getattr(together, f) for f in facts]
    expected = (
        [n == t or t == 1 for n, t in zip(number, total, strict=True)] if together.usable else [True] * len(number)
    )
    assert together.last.tolist() == expected
