"""Flags that share a byte with the class before point format 6, and classes and flags of the later formats."""

from __future__ import annotations

import json
import sys
from datetime import date
from pathlib import Path

import laspy
import numpy as np
import pytest
from pyproj import CRS
from slopewatch.engine.epochs.epoch import Epoch
from slopewatch.engine.ground.extraction import extract_ground
from slopewatch.engine.ground.result import GroundResult
from slopewatch.engine.pointcloud.pdal_program import Pdal
from slopewatch.engine.pointcloud.writing import Copy, copies
from slopewatch.interface.parameters import ChangeParameters, LastEpochParameters, ReportParameters
from slopewatch.tests.builders.epoch_pairs import slope
from slopewatch.tests.builders.extracted_ground import any_pdal
from slopewatch.workflows.inspect import inspect_slope
from slopewatch.workflows.settings import Settings

FLAGS = ("synthetic", "key_point", "withheld", "overlap")
OLD, NEW = (1, 3), (6, 7)
CLASSES = {1: (2, 12), 3: (2, 31), 6: (2, 12, 64, 200), 7: (2, 31, 130)}


STAND_IN = '''#!{python}
"""PDAL from 2.4 on: class 12 of formats before 6 is read as class 0 with the overlap flag; then the real one."""
import json, os, subprocess, sys
if sys.argv[1:] == ["--version"]:
    sys.exit(print("pdal 2.9.1 (git-version: stand-in)"))
import laspy
stages = json.loads(sys.stdin.read())
reader = stages["pipeline"][0]
las = laspy.read(reader["filename"])
if las.point_format.id < 6:
    was = las.classification == 12
    las = laspy.convert(las, point_format_id=7 if las.point_format.id > 1 else 6, file_version="1.4")
    las.overlap[was], las.classification[was] = 1, 0
    reader["filename"] = os.path.join(os.getcwd(), "modern.las")
    las.write(reader["filename"])
sys.exit(subprocess.run([{pdal!r}, *sys.argv[1:]], input=json.dumps(stages).encode()).returncode)
'''


@pytest.fixture(autouse=True, params=["the PDAL at hand", "as from 2.4 on", "none"])
def _pdal(request, tmp_path, monkeypatch) -> None:
    if request.param == "none":
        monkeypatch.setenv("SLOPEWATCH_PDAL", "none")
        return
    real = any_pdal().path
    if request.param == "as from 2.4 on":
        if real is None:
            pytest.skip("the stand-in passes pipelines on to the pdal program")
        program = tmp_path / "pdal"
        program.write_text(STAND_IN.format(python=sys.executable, pdal=str(real)))
        program.chmod(0o755)
        monkeypatch.setenv("SLOPEWATCH_PDAL", str(program))
        monkeypatch.setattr(Pdal, "has_csf", False)  # the real one's may not work


def write(path: Path, point_format: int, classes: tuple[int, ...], flags: tuple[str, ...], seed: int = 1) -> Path:
    """A slope with ``classes`` and ``flags`` in all combinations, drawn at random."""
    xyz = slope(seed, 3000)
    rng = np.random.default_rng(seed)
    header = laspy.LasHeader(point_format=point_format, version="1.2" if point_format < 6 else "1.4")
    header.scales, header.offsets = [0.001] * 3, np.floor(xyz[0])
    header.add_crs(CRS.from_epsg(32651))
    las = laspy.LasData(header)
    las.xyz = xyz
    las.return_number = las.number_of_returns = np.ones(len(xyz), dtype=np.uint8)
    las.classification = rng.choice(classes, len(xyz))
    for name in flags:
        las[name] = rng.integers(0, 2, len(xyz))
    las.write(path)
    return path


def labelled(las: laspy.LasData, *, flags_only: bool = False) -> set[tuple[int, ...]]:
    """Place, class and flags of every point; only LAS 1.4 knows of overlap."""
    known = set(las.point_format.dimension_names)
    columns = [np.rint(las.xyz[:, axis] * 1000).astype(np.int64) for axis in range(3)]
    columns += [] if flags_only else [np.asarray(las.classification)]
    columns += [np.asarray(las[name]) if name in known else np.zeros(len(las.points)) for name in FLAGS]
    return set(zip(*(c.astype(np.int64).tolist() for c in columns), strict=True))


def extract(source: Path) -> GroundResult:
    return extract_ground(source, source.with_name("a_ground.laz"))


@pytest.mark.parametrize(
    ("point_format", "flags"),
    [(f, flags) for f in OLD for flags in ((), *((name,) for name in FLAGS[:3]), FLAGS[:3])]
    + [(f, flags) for f in NEW for flags in ((), *((name,) for name in FLAGS), FLAGS)],
)
def test_classes_and_flags_survive_the_extraction(tmp_path, point_format, flags):
    source = write(tmp_path / "a.laz", point_format, CLASSES[point_format], flags)
    found = extract(source)
    raw = laspy.read(source)
    assert labelled(laspy.read(found.clipped)) == labelled(raw)
    ground = laspy.read(found.ground)
    assert found.ground_points > 0.9 * len(raw.points)
    assert labelled(ground, flags_only=True) <= labelled(raw, flags_only=True)
    assert set(np.unique(ground.classification)) == {2}


def test_named_noise_is_left_out_where_it_is_flagged(tmp_path):
    source = write(tmp_path / "a.laz", 1, (2, 7), ("withheld",))
    found = extract(source)
    assert found.outliers == int(np.sum(laspy.read(source).classification == 7)) > 1000


def test_the_kept_pipeline_reads_the_cloud_itself(tmp_path):
    source = write(tmp_path / "a.laz", 3, (2,), ("withheld",))
    kept = next(p for p in extract(source).pipelines if p.name.endswith("_clip.json"))
    assert json.loads(kept.read_text())["pipeline"][0]["filename"] == str(source)
    assert not (tmp_path / "a_clip.las").exists()


@pytest.mark.parametrize("point_format", [1, 7])
def test_an_inspection_of_flagged_clouds(tmp_path, point_format):
    epochs = [
        Epoch(write(tmp_path / f"{seed}.laz", point_format, CLASSES[point_format], FLAGS[:3], seed), day)
        for seed, day in ((1, date(2024, 5, 1)), (2, date(2025, 5, 1)))
    ]
    settings = Settings(
        change=ChangeParameters(cell=0.5),
        screening=LastEpochParameters(screen_last_epoch=False),
        report=ReportParameters(zone_profiles=0),
    )
    done = inspect_slope(epochs, tmp_path / "out", settings)
    outputs, figures = done.outputs, done.figures
    assert figures["reference_ground_points"] > 2700
    moved = laspy.read(outputs["aligned"])
    assert len(np.unique(np.stack([moved[name] for name in FLAGS[:3]]), axis=1).T) == 8


def test_bytes_of_an_older_format_become_class_and_flags(tmp_path):
    source = write(tmp_path / "a.laz", 6, tuple(range(256)), ("overlap",))
    copies(source, [Copy(tmp_path / "b.laz")], flags_in_class=True)
    before, after = laspy.read(source), laspy.read(tmp_path / "b.laz")
    byte = np.asarray(before.classification)
    assert np.array_equal(after.classification, byte & 31)
    assert np.array_equal(after.overlap, before.overlap)
    for bit, name in enumerate(FLAGS[:3], 5):
        assert np.array_equal(after[name], byte >> bit & 1)
