"""Ground in tiles against that in one piece, the simulation's truth and real tiles; what is refused; no leftovers."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
import time
from collections import namedtuple
from pathlib import Path

import laspy
import numpy as np
import pytest
from slopewatch.engine.core.errors import InputError
from slopewatch.engine.core.progress import Progress
from slopewatch.engine.ground.extraction import extract_ground
from slopewatch.engine.pointcloud.pdal_program import Pdal
from slopewatch.interface.parameters import GroundParameters, InputParameters
from slopewatch.tests.builders.extracted_ground import any_pdal
from slopewatch.tests.builders.limits import CANCELLED_S, PATIENCE_S
from slopewatch.tests.builders.long_slope import SMALL_GB

REAL = Path(__file__).parents[5] / "shared" / "data" / "real" / "ign_tiles"
MAX_DIFFERENT_SHARE = 0.02
"""Of the ground's points, those that only one of the two ways takes for ground; at edges the cloth's seeds decide."""


def labels(path: Path) -> np.ndarray:
    return np.asarray(laspy.read(path).classification) == 2


def raw(path: Path, *names: str) -> np.ndarray:
    las = laspy.read(path)
    return np.column_stack([np.asarray(las[name], dtype=np.float64) for name in names])


def test_the_ground_is_that_in_one_piece(in_one_piece, in_tiles):
    assert in_one_piece.tiles is None
    assert in_tiles.tiles.count >= 3
    names = ("X", "Y", "Z", "gps_time", "intensity", "red", "return_number", "user_data")
    for one, other in ((in_one_piece.clipped, in_tiles.clipped), (in_one_piece.classified, in_tiles.classified)):
        assert np.array_equal(raw(one, *names), raw(other, *names))
    assert in_tiles.clipped.read_bytes() == in_one_piece.clipped.read_bytes()
    one, other = labels(in_one_piece.classified), labels(in_tiles.classified)
    assert np.count_nonzero(one != other) <= MAX_DIFFERENT_SHARE * np.count_nonzero(one)
    heights = [raw(r.classified, "height_over_ground")[:, 0] for r in (in_one_piece, in_tiles)]
    known = np.isfinite(heights[0]) & np.isfinite(heights[1])
    assert known.mean() > 0.98
    difference = np.abs(heights[0] - heights[1])
    assert np.median(difference[known]) < 0.002
    assert np.quantile(difference[known & one & other], 0.9) < 0.02


def test_the_three_files_hold_the_same_points_and_heights(in_tiles):
    classified, ground = laspy.read(in_tiles.classified), laspy.read(in_tiles.ground)
    chosen = np.asarray(classified.classification) == 2
    assert len(ground.x) == in_tiles.ground_points == np.count_nonzero(chosen)
    assert len(classified.x) == in_tiles.roi_points - in_tiles.outliers
    for name in ("gps_time", "height_over_ground", "plant_error", "plant_height"):
        assert np.array_equal(np.asarray(classified[name])[chosen], np.asarray(ground[name]))
    assert (np.asarray(ground.classification) == 2).all()


def test_the_ground_is_that_of_the_truth(in_tiles):
    las = laspy.read(in_tiles.classified)
    truth, found = np.asarray(las.user_data) == 1, np.asarray(las.classification) == 2
    assert np.count_nonzero(found & truth) >= 0.95 * np.count_nonzero(truth)
    assert np.count_nonzero(found & truth) >= 0.9 * np.count_nonzero(found)


def test_what_is_decided_and_counted_is_that_in_one_piece(in_one_piece, in_tiles):
    one, other = in_one_piece, in_tiles
    assert other.plane_normal == pytest.approx(one.plane_normal, abs=1e-12)
    assert (other.roi_points, other.outliers) == (one.roi_points, one.outliers)
    assert other.outliers >= 5
    assert (other.scatter, other.threshold) == pytest.approx((one.scatter, one.threshold), rel=0.02)
    assert (other.spacing, other.roi_area) == pytest.approx((one.spacing, one.roi_area), rel=0.02)
    assert other.vegetation_cover == pytest.approx(one.vegetation_cover, abs=0.005)
    assert other.cover.area_m2 == pytest.approx(one.cover.area_m2, rel=1e-9)
    assert sum(other.cover.heights.returns) == pytest.approx(sum(one.cover.heights.returns), rel=0.004)
    for a, b in zip(one.cover.classes, other.cover.classes, strict=True):
        assert b.area_share == pytest.approx(a.area_share, abs=0.01)
    assert [w.split("'")[-1][:40] for w in other.warnings] == [w.split("'")[-1][:40] for w in one.warnings]


def test_the_seams_are_named(in_tiles):
    tiles = in_tiles.tiles
    assert tiles.seam_points > 500
    assert tiles.seam_median_m < 0.002
    assert tiles.seam_share_beyond < 0.03
    assert tiles.memory_limit_gb == pytest.approx(SMALL_GB)
    assert "tiles" in in_tiles.filter


def test_nothing_is_left_but_the_outputs(in_tiles):
    names = {p.name for p in in_tiles.ground.parent.iterdir()}
    assert names == {"a_ground.laz", "a_clipped.laz", "a_classified.laz", "a_clip.json", "a_select.json"}


def test_the_cloth_alone_is_laid_in_tiles_too(long_cloud, tmp_path):
    found = []
    for limit in ("auto", SMALL_GB):
        parameters = GroundParameters(refine=False, class_threshold=0.1, ground_memory=limit)
        result = extract_ground(long_cloud, tmp_path / f"{limit}.laz", parameters=parameters, pdal=any_pdal())
        assert not list(laspy.read(result.classified).point_format.extra_dimension_names)
        found.append(labels(result.classified))
        assert (result.tiles is None) == (limit == "auto")
    # a cloth falls from the height of its own highest point, and rests a little otherwise
    assert np.count_nonzero(found[0] != found[1]) < 0.08 * np.count_nonzero(found[0])


def no_pdal() -> Pdal:
    """A program that cannot start: what is refused with it was refused before any work."""
    return Pdal(Path("/nowhere/pdal"), "2.4.0", "test")


def test_a_limit_too_small_even_for_tiles_is_refused_with_figures_before_any_work(las_file, tmp_path):
    cloud = las_file(tmp_path / "dense.las", points=300_000)
    with pytest.raises(InputError) as caught:
        extract_ground(cloud, tmp_path / "g.laz", parameters=GroundParameters(ground_memory=0.4), pdal=no_pdal())
    sentence = str(caught.value)
    for words in ("dense.las", "300,000 points", "ground_memory allows 0.4 GB"):
        assert words in sentence
    assert sentence.endswith(".")
    assert "\n" not in sentence
    assert [p.name for p in tmp_path.iterdir()] == ["dense.las"]


def test_a_disk_too_full_is_refused_before_any_work(long_cloud, tmp_path, monkeypatch):
    usage = namedtuple("usage", "total used free")
    monkeypatch.setattr(shutil, "disk_usage", lambda _: usage(10**9, 10**9, 10**6))
    parameters = GroundParameters(ground_memory=SMALL_GB)
    with pytest.raises(InputError, match=r"needs 0\.0\d+ GB on the disk of .* 0\.001 GB are free"):
        extract_ground(long_cloud, tmp_path / "g.laz", parameters=parameters, pdal=no_pdal())
    assert not list(tmp_path.iterdir())


def test_progress_tells_the_tiles(long_cloud, tmp_path):
    messages: list[str] = []

    class Told(Progress):
        def emit(self, percent: float, message: str) -> None:
            messages.append(message)

    parameters = GroundParameters(ground_memory=SMALL_GB, refine=False)
    result = extract_ground(long_cloud, tmp_path / "g.laz", parameters=parameters, pdal=any_pdal(), progress=Told())
    count = result.tiles.count
    assert [m for m in messages if m.startswith("tile ")] == [f"tile {n} of {count}" for n in range(1, count + 1)]


@pytest.mark.skipif(os.name != "posix", reason="signals")
def test_cancelled_among_the_tiles_leaves_nothing(long_cloud, tmp_path):
    command = ["ground", str(long_cloud), "--output", str(tmp_path / "g.laz"), "--ground-memory", str(SMALL_GB)]
    child = subprocess.Popen([sys.executable, "-m", "slopewatch.cli", *command, "--progress", "none"])
    until = time.monotonic() + PATIENCE_S
    while time.monotonic() < until and not list(tmp_path.glob(".slopewatch-part-*/*_tiles/*.surface")):
        assert child.poll() is None
        time.sleep(0.02)
    child.send_signal(signal.SIGINT)
    assert child.wait(CANCELLED_S) == 130
    assert not list(tmp_path.iterdir())


@pytest.mark.skipif(not REAL.is_dir(), reason="no real tiles at hand")
def test_two_adjoining_real_tiles_have_the_ground_of_one_piece(tmp_path):
    parts = [laspy.read(p) for p in sorted(REAL.glob("test_data_77050_6277*.laz"))]
    whole = laspy.LasData(parts[0].header)
    whole.points = laspy.ScaleAwarePointRecord(
        np.concatenate([p.points.array for p in parts]), parts[0].point_format, parts[0].header.scales,
        parts[0].header.offsets,
    )  # fmt: skip
    assert all(np.array_equal(p.header.scales, parts[0].header.scales) for p in parts)
    whole.write(tmp_path / "both.laz")
    found = []
    for limit in ("auto", 0.41):
        parameters = GroundParameters(ground_memory=limit)
        inputs = InputParameters(crs="EPSG:2154")
        path = tmp_path / str(limit) / "a_ground.laz"
        path.parent.mkdir()
        result = extract_ground(tmp_path / "both.laz", path, parameters=parameters, inputs=inputs, pdal=any_pdal())
        found.append((result, labels(result.classified)))
    assert found[0][0].tiles is None
    assert found[1][0].tiles.count >= 2
    assert np.count_nonzero(found[0][1] != found[1][1]) <= MAX_DIFFERENT_SHARE * np.count_nonzero(found[0][1])
