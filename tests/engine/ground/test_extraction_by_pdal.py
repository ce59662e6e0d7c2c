"""The cloth laid by PDAL's own filter gives the ground of the cloth laid by the library."""

from __future__ import annotations

import sys

import laspy
import pytest
from slopewatch.engine.ground.extraction import extract_ground
from slopewatch.engine.pointcloud.pdal_program import find_pdal
from slopewatch.interface.parameters import GroundParameters
from slopewatch.tests.builders.extracted_ground import any_pdal, old_pdal, rows

STAND_IN = '''#!{python}
"""Does what PDAL's documentation says of the cloth's pipeline, with laspy; all else is left to the real PDAL."""
import json, os, subprocess, sys
if sys.argv[1:] == ["--version"]:
    print("pdal 2.9.1 (git-version: stand-in)")
    sys.exit()
text = sys.stdin.read()
stages = json.loads(text)["pipeline"]
if not any(s["type"] == "filters.csf" for s in stages):
    sys.exit(subprocess.run([{pdal!r}, *sys.argv[1:]], input=text.encode()).returncode)
import laspy, numpy as np, CSF
las = xyz = None
for stage in stages:
    kind = stage.pop("type")
    if kind == "readers.las":
        las = laspy.read(stage["filename"])
        xyz = np.array(las.xyz)
    elif kind == "filters.assign":
        assert stage == {{"value": "Classification = 1"}}
        las.classification = np.ones(len(xyz), np.uint8)
    elif kind == "filters.transformation":
        m = np.array(stage["matrix"].split(), float).reshape(4, 4)
        xyz = np.column_stack([(xyz * m[r, :3]).sum(axis=1) + m[r, 3] for r in range(3)])
    elif kind == "filters.csf":
        number, total = np.asarray(las.return_number), np.asarray(las.number_of_returns)
        kinds = {{"first": (number == 1) & (total > 1), "only": total == 1, "last": (number == total) & (total > 1),
                 "intermediate": (number > 1) & (number < total)}}
        chosen = np.flatnonzero(np.any([kinds[r.strip()] for r in stage["returns"].split(",")], axis=0))
        if not number.any():
            chosen = np.arange(len(xyz))
        cloth = CSF.CSF()
        cloth.params.bSloopSmooth, cloth.params.time_step = stage["smooth"], stage["step"]
        cloth.params.class_threshold, cloth.params.cloth_resolution = stage["threshold"], stage["resolution"]
        cloth.params.rigidness, cloth.params.interations = stage["rigidness"], stage["iterations"]
        cloth.setPointCloud(np.ascontiguousarray(xyz[chosen]))
        ground, rest = CSF.VecInt(), CSF.VecInt()
        devnull = os.open(os.devnull, os.O_WRONLY); os.dup2(devnull, 1)
        cloth.do_filtering(ground, rest, False)
        labels = np.asarray(las.classification).copy()
        labels[chosen[np.array(ground, int)]] = 2
        las.classification = labels
    elif kind == "writers.las":
        assert stage["forward"] == "header,scale,offset"
        las.x, las.y, las.z = xyz.T
        las.write(stage["filename"])
    else:
        sys.exit("unknown stage " + kind)
'''


@pytest.mark.parametrize("parameters", [{}, {"slope_aligned": False}, {"refine": False, "class_threshold": 0.1}])
def test_the_cloth_laid_by_pdal_gives_the_same_ground(inputs, tmp_path, monkeypatch, parameters):
    """The path for PDAL 2.3 and later, whose filters.csf is played by a stand-in that follows its documentation."""
    real = any_pdal()
    if real.path is None:
        pytest.skip("the stand-in passes other pipelines on to the pdal program")
    program = tmp_path / "pdal"
    program.write_text(STAND_IN.format(python=sys.executable, pdal=str(real.path)))
    program.chmod(0o755)
    settings = GroundParameters(**parameters)
    by_pdal = extract_ground(inputs[0], tmp_path / "a.laz", roi=inputs[1], parameters=settings, pdal=find_pdal(program))
    by_library = extract_ground(inputs[0], tmp_path / "b.laz", roi=inputs[1], parameters=settings, pdal=old_pdal())
    assert by_pdal.filter == "PDAL 2.9.1 filters.csf"
    assert [p.name for p in by_pdal.pipelines] == ["a_clip.json", "a_cloth.json", "a_select.json"]
    assert not (tmp_path / "a_cloth.laz").exists()
    one, other = (set(laspy.read(r.ground).gps_time) for r in (by_pdal, by_library))
    # the same points to the last digit but one: the cloth's corner is rounded differently
    assert len(one ^ other) <= 0.001 * len(other)
    assert rows(by_pdal.ground) <= rows(inputs[0])


def test_filters_csf_itself_gives_the_same_ground(inputs, tmp_path):
    """Runs where a PDAL 2.3 or later is found; two implementations of one algorithm may differ in 0.5 % of points."""
    pdal = any_pdal()
    if not pdal.has_csf:
        pytest.skip(f"PDAL {pdal.version}: its filters.csf does not work; a PDAL of 2.3 or later is needed")
    for name, parameters in {"default": GroundParameters(), "paper": GroundParameters.build(profile="paper")}.items():
        by_pdal = extract_ground(inputs[0], tmp_path / f"{name}.laz", roi=inputs[1], parameters=parameters, pdal=pdal)
        by_library = extract_ground(
            inputs[0], tmp_path / f"{name}_b.laz", roi=inputs[1], parameters=parameters, pdal=old_pdal()
        )
        assert by_pdal.filter == f"PDAL {pdal.version} filters.csf"
        one, other = (set(laspy.read(r.ground).gps_time) for r in (by_pdal, by_library))
        assert len(one ^ other) <= 0.005 * len(other)
        assert rows(by_pdal.ground) <= rows(inputs[0])
