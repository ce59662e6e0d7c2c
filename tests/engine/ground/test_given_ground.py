"""Ground that the survey gives itself: class 2, or all points; and when class 2 is not believed."""

from __future__ import annotations

from pathlib import Path

import laspy
import numpy as np
import pytest
from pyproj import CRS
from slopewatch.engine.core.errors import InputError
from slopewatch.engine.core.progress import Progress
from slopewatch.engine.ground import given_ground
from slopewatch.engine.ground.classified_ground import lower_share, warn_of_lower_points
from slopewatch.engine.ground.extraction import extract_ground
from slopewatch.engine.ground.given_ground import has_class_2
from slopewatch.engine.pointcloud.cloud import PointCloud
from slopewatch.engine.pointcloud.writing import write_cloud
from slopewatch.interface.parameters import GroundParameters, RawGroundParameters
from slopewatch.tests.builders.ground_choice import RIDGE, forest, region


def taken(path: Path, ground: str, tmp_path: Path, **given):
    return extract_ground(path, tmp_path / "a_ground.laz", parameters=RawGroundParameters(ground=ground), **given)


@pytest.fixture
def survey(tmp_path):
    xyz, ground = forest()
    path = tmp_path / "survey.laz"
    labels = np.where(ground, 2, 1).astype(np.uint8)
    write_cloud(path, PointCloud(xyz, CRS(32651), path, classification=labels))
    return path, xyz, ground


def test_class_2_is_taken_as_it_is_within_the_region(survey, tmp_path):
    path, xyz, ground = survey
    roi = region(tmp_path / "roi.gpkg", width=8.0005)
    found = taken(path, "class_2", tmp_path, roi=roi)
    inside = xyz[:, 0] < RIDGE[0] + 8.0005
    kept = laspy.read(found.ground)
    np.testing.assert_allclose(np.sort(kept.x), np.sort(xyz[ground & inside, 0]), atol=1e-3)
    assert set(np.asarray(kept.classification)) == {2}
    assert (found.roi_points, found.ground_points) == (inside.sum(), (ground & inside).sum())
    classified = laspy.read(found.classified)
    assert np.count_nonzero(classified.classification == 2) == found.ground_points
    assert found.filter == "class 2 of the survey"
    # somebody else's classes say nothing of the vegetation
    assert (found.vegetation_cover, found.cover, found.outliers) == (None, None, 0)
    assert "vegetation_cover" not in found.figures()
    assert found.sentence() == f"Ground: the points of class 2, {100 * found.ground_ratio:.0f} % of all points."
    assert found.plane_dip == pytest.approx(np.degrees(np.arctan(0.6)), abs=0.5)


def test_as_is_takes_every_point(survey, tmp_path):
    path, xyz, _ = survey
    found = taken(path, "as_is", tmp_path)
    assert laspy.open(found.ground).header.point_count == found.ground_points == len(xyz)
    assert found.sentence() == "Ground: all points, as they are."
    assert not found.warnings


def test_extract_is_the_default_and_what_it_was(survey, tmp_path):
    path, _, _ = survey
    ours = extract_ground(path, tmp_path / "a.laz", parameters=RawGroundParameters())
    before = extract_ground(path, tmp_path / "b.laz", parameters=GroundParameters())
    assert ours.ground.read_bytes() == before.ground.read_bytes()
    assert ours.filter == before.filter != "class 2 of the survey"


def test_a_large_survey_is_judged_by_a_part_and_taken_whole(survey, tmp_path, monkeypatch):
    path, _, ground = survey
    monkeypatch.setattr(given_ground, "_MAX_SAMPLE_POINTS", 8_000)
    monkeypatch.setattr(given_ground, "_SQUARE_SIDE_M", 2.0)
    sample = given_ground.given_ground(path, "class_2")
    assert 4_000 < len(sample.xyz) < 12_000
    assert sample.mask.sum() == ground.sum()
    found = taken(path, "class_2", tmp_path)
    assert found.ground_points == ground.sum()


def test_class_2_on_top_of_the_canopy_is_refused(survey, tmp_path):
    path, xyz, ground = survey
    write_cloud(path, PointCloud(xyz, CRS(32651), path, classification=np.where(ground, 1, 2).astype(np.uint8)))
    with pytest.raises(InputError, match=r"class 2.*lie more than 0.3 m.*extract its ground instead\.$"):
        taken(path, "class_2", tmp_path)
    assert not list(tmp_path.glob("a_*"))


def test_many_points_below_class_2_are_told_and_most_are_refused(survey):
    _, xyz, ground = survey
    progress = Progress()
    warn_of_lower_points(Path("a.laz"), xyz[ground], xyz[~ground], progress.warning)
    assert progress.warnings == []
    # ground that somebody lifted by half a metre in a strip of the slope: what is below are its own returns
    for width, refused in ((1.5, False), (10.0, True)):
        lifted = xyz[ground]
        strip = lifted[:, 0] < RIDGE[0] + width
        below = lifted[strip]
        lifted[strip, 2] += 0.5
        share = lower_share(lifted, np.concatenate([xyz[~ground], below]))
        assert share == pytest.approx(width / 20.0, abs=0.06)
        if refused:
            with pytest.raises(InputError, match=r"so class 2 is not the ground; extract its ground instead\.$"):
                warn_of_lower_points(Path("a.laz"), lifted, below, progress.warning)
        else:
            warn_of_lower_points(Path("a.laz"), lifted, below, progress.warning)
            [sentence] = progress.warnings
            assert "of the area of 'a.laz' with points of class 2, other points lie more than 0.3 m below" in sentence


def test_no_class_2_within_the_region_is_refused(survey, tmp_path):
    path, xyz, ground = survey
    away = xyz[:, 0] > RIDGE[0] + 10.0
    write_cloud(path, PointCloud(xyz, CRS(32651), path, classification=np.where(ground & away, 2, 1).astype(np.uint8)))
    with pytest.raises(InputError, match="has no points of class 2 in the region"):
        taken(path, "class_2", tmp_path, roi=region(tmp_path / "roi.gpkg", width=8.0005))


def test_whether_there_is_class_2_is_seen_at_the_end_of_the_file(survey, tmp_path):
    path, xyz, _ = survey
    assert has_class_2(path)
    assert has_class_2(path, every=False)
    labels = np.ones(len(xyz), np.uint8)
    write_cloud(tmp_path / "none.laz", PointCloud(xyz, CRS(32651), path, classification=labels))
    assert not has_class_2(tmp_path / "none.laz")
    labels[-1] = 2
    write_cloud(tmp_path / "one.laz", PointCloud(xyz, CRS(32651), path, classification=labels))
    assert has_class_2(tmp_path / "one.laz")
