"""The whole ground extraction on files: real PDAL, simulated and real clouds, and what goes wrong."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import geopandas
import laspy
import numpy as np
import pytest
import shapely
from pyproj import CRS
from slopewatch.engine.core.errors import InputError
from slopewatch.engine.core.progress import Progress
from slopewatch.engine.ground import extraction as module
from slopewatch.engine.ground.extraction import extract_ground
from slopewatch.engine.ground.filtering import ground_mask
from slopewatch.engine.ground.result import GroundResult
from slopewatch.engine.pointcloud.pdal_program import Pdal, find_pdal
from slopewatch.interface.parameters import GroundParameters, InputParameters, SurveyParameters
from slopewatch.simulation.surveys.survey import SimulatedPair, simulate_pair
from slopewatch.tests.builders.limits import CANCELLED_S, PATIENCE_S

SURVEY = SurveyParameters(seed=3, points=90_000, length=18.0, height=9.0)


@pytest.fixture(scope="module")
def pair() -> SimulatedPair:
    return simulate_pair(SURVEY)


def write(pair: SimulatedPair, path: Path, change: Callable[[laspy.LasData], None] | None = None) -> Path:
    """The first survey as LAS 1.4 with its truth as user data, and a unique GPS time a point."""
    cloud = pair.first
    header = laspy.LasHeader(point_format=7, version="1.4")
    header.scales, header.offsets = [0.001] * 3, [*np.floor(cloud.xyz.mean(axis=0))]
    header.add_crs(CRS.from_user_input(pair.crs))
    las = laspy.LasData(header)
    las.x, las.y, las.z = cloud.xyz.T
    las.return_number, las.number_of_returns = cloud.return_number, cloud.number_of_returns
    las.gps_time, las.user_data, las.intensity = np.arange(len(cloud)), cloud.truth_ground, cloud.intensity
    las.red, las.green, las.blue = cloud.rgb.T.astype(np.uint16) * 257
    if change is not None:
        change(las)
    las.write(path)
    return path


@pytest.fixture(scope="module")
def inputs(pair, tmp_path_factory) -> tuple[Path, Path]:
    """Cloud and region."""
    folder = tmp_path_factory.mktemp("survey")
    region = folder / "roi.gpkg"
    geopandas.GeoDataFrame(geometry=[shapely.Polygon(pair.roi)], crs=pair.crs).to_file(region)
    return write(pair, folder / "survey.las"), region


@pytest.fixture(scope="module")
def result(inputs, tmp_path_factory) -> GroundResult:
    return extract_ground(inputs[0], tmp_path_factory.mktemp("out") / "a_ground.laz", roi=inputs[1], pdal=any_pdal())


def any_pdal() -> Pdal:
    try:
        return find_pdal()
    except InputError as error:
        pytest.skip(f"no PDAL: {error}")


def old_pdal() -> Pdal:
    """The PDAL at hand, as one whose filters.csf does not work."""
    found = any_pdal()
    return Pdal(found.path, "2.2.0", found.how)


def rows(path: Path) -> set[tuple[float, ...]]:
    """What identifies points, by all that must not change."""
    las = laspy.read(path)
    names = ("gps_time", "X", "Y", "Z", "intensity", "red", "return_number", "user_data")
    return set(zip(*(np.asarray(las[n]).tolist() for n in names), strict=True))


def test_the_ground_is_that_of_the_truth_and_its_points_are_untouched(inputs, result):
    raw, found = laspy.read(inputs[0]), laspy.read(result.ground)
    assert rows(result.ground) <= rows(result.clipped) <= rows(inputs[0])
    assert (np.asarray(found.classification) == 2).all()
    region = geopandas.read_file(inputs[1]).geometry[0]
    inside = shapely.contains_xy(region, np.array(raw.x), np.array(raw.y))
    truth = inside & (np.asarray(raw.user_data) == 1)
    right = np.count_nonzero(found.user_data)
    assert right / truth.sum() >= 0.97
    assert right / len(found.x) >= 0.96
    labels = laspy.read(result.classified)
    assert len(labels.x) == result.roi_points - result.outliers
    assert np.array_equal(np.sort(labels.gps_time[np.asarray(labels.classification) == 2]), np.sort(found.gps_time))


def test_the_files_say_how_high_points_stand_and_what_plants_cost(pair, result):
    las, ground = laspy.read(result.classified), laspy.read(result.ground)
    height, labels = np.asarray(las.height_over_ground), np.asarray(las.classification)
    truth = np.asarray(las.z) - pair.scene.with_changes(()).height_at(np.array(las.xyz))
    known = np.isfinite(height)
    assert known[labels == 2].all()
    assert np.abs(height - truth)[labels == 2].mean() < 0.02
    # in the vertical, on a slope of 39 degrees
    plants = known & (truth > 0.3) & (truth < 0.6)
    assert np.median(height[plants] / truth[plants]) == pytest.approx(1.0, abs=0.05)
    for name in ("plant_error", "plant_height"):
        values = np.asarray(las[name])
        assert values.dtype == np.float32
        assert (values[labels == 2] >= 0).all()
        by_time = dict(zip(np.asarray(las.gps_time).tolist(), values.tolist(), strict=True))
        assert [by_time[t] for t in np.asarray(ground.gps_time).tolist()] == np.asarray(ground[name]).tolist()
    # most of this slope's ground shows itself between the plants
    assert np.median(ground.plant_error) == 0.0
    assert np.nanmedian(las.plant_height[truth < 1.0]) > 0.0


def test_without_refinement_nothing_is_said_of_plants(inputs, tmp_path):
    parameters = GroundParameters(refine=False, class_threshold=0.1)
    found = extract_ground(inputs[0], tmp_path / "g.laz", roi=inputs[1], parameters=parameters, pdal=any_pdal())
    for path in (found.classified, found.ground):
        assert not list(laspy.read(path).point_format.extra_dimension_names)


def test_ground_of_a_classified_cloud_replaces_what_the_file_said_of_plants(result, tmp_path):
    again = extract_ground(result.classified, tmp_path / "g.laz", pdal=any_pdal())
    for path in (again.classified, again.ground):
        names = list(laspy.read(path).point_format.extra_dimension_names)
        assert sorted(names) == ["height_over_ground", "plant_error", "plant_height"]
    assert abs(again.ground_points - result.ground_points) < 0.01 * result.ground_points


def test_the_reported_figures_are_those_of_the_points(pair, inputs, result):
    raw, found = laspy.read(inputs[0]), laspy.read(result.ground)
    region = geopandas.read_file(inputs[1]).geometry[0]
    inside = shapely.contains_xy(region, np.array(raw.x), np.array(raw.y))
    assert result.raw_points == len(raw.x)
    assert result.raw_area == len(set(zip(np.floor(raw.x).tolist(), np.floor(raw.y).tolist(), strict=True)))
    assert result.raw_density == pytest.approx(result.raw_points / result.raw_area)
    assert abs(result.roi_points - inside.sum()) <= 3
    assert result.roi_area == pytest.approx(region.area)
    assert result.roi_density == pytest.approx(result.roi_points / region.area)
    assert result.ground_points == len(found.x)
    assert result.ground_ratio == pytest.approx(len(found.x) / result.roi_points)
    u, v = pair.scene.slope[2:]
    assert result.vegetation_cover == pytest.approx(pair.canopy.cover((-1.0, -1.0, u + 1, v + 1)), abs=0.06)
    assert result.plane_dip == pytest.approx(39.0, abs=1.5)
    assert set(result.seconds) == {"read", "clip", "denoise", "cloth", "refine", "write"}
    assert {"roi_points", "ground_ratio", "vegetation_cover"} <= result.figures().keys()
    json.dumps(result.figures())


def test_the_same_input_gives_the_same_bytes_and_the_kept_pipelines_run_again(inputs, result, tmp_path):
    again = extract_ground(inputs[0], tmp_path / "a_ground.laz", roi=inputs[1], pdal=any_pdal())
    for one, other in ((result.ground, again.ground), (result.clipped, again.clipped)):
        assert one.read_bytes() == other.read_bytes()
    names = {p.name for p in tmp_path.iterdir()}
    assert {"a_ground.laz", "a_clipped.laz", "a_classified.laz", "a_clip.json", "a_select.json"} <= names
    assert names == {p.name for p in (again.ground, again.clipped, again.classified, *again.pipelines)}
    if any_pdal().path is None:
        return
    again.ground.unlink()
    subprocess.run([any_pdal().path, "pipeline", tmp_path / "a_select.json"], check=True, cwd="/")
    assert again.ground.read_bytes() == result.ground.read_bytes()


def test_arrays_and_files_give_the_same_ground(result):
    las = laspy.read(result.clipped)
    found = ground_mask(np.array(las.xyz), last=np.asarray(las.return_number == las.number_of_returns))
    assert set(laspy.read(result.ground).gps_time) == set(las.gps_time[found])


def test_strays_are_left_out_and_cost_no_ground(pair, inputs, result, tmp_path):
    def add_strays(las: laspy.LasData) -> None:
        inside = np.flatnonzero(las.user_data)[:: len(las.x) // 40][:6]
        las.z[inside] = las.z[inside] + np.array([-2e6, -5.0, -5.0, -60.0, 40.0, 900.0])

    cloud = write(pair, tmp_path / "strays.las", add_strays)
    found = extract_ground(cloud, tmp_path / "g.laz", roi=inputs[1], pdal=any_pdal())
    assert 1 <= found.outliers <= 6
    assert abs(found.ground_points - result.ground_points) < 0.002 * result.ground_points + 8
    low = laspy.read(found.clipped).header.mins[2]
    assert low > pair.first.xyz[:, 2].min() - 0.1


def test_a_region_of_parts_with_holes_in_another_system_is_taken(pair, inputs, tmp_path):
    whole = shapely.Polygon(pair.roi)
    half = shapely.affinity.scale(whole, 0.4, 0.9, origin=whole.exterior.coords[0])
    parts = shapely.MultiPolygon([half.difference(half.centroid.buffer(1.5)), whole.centroid.buffer(2.0)])
    geopandas.GeoSeries([parts], crs=pair.crs).to_crs(4326).to_file(tmp_path / "roi.geojson")
    found = extract_ground(inputs[0], tmp_path / "g.laz", roi=tmp_path / "roi.geojson", pdal=any_pdal())
    raw = pair.first.xyz
    inside = shapely.contains_xy(shapely.union_all(list(parts.geoms)), raw[:, 0], raw[:, 1])
    assert found.roi_points == pytest.approx(inside.sum(), abs=20)
    assert any("transformed" in w for w in found.warnings)


def test_without_a_region_a_stray_far_beside_does_no_harm(pair, inputs, tmp_path):
    def move(las: laspy.LasData) -> None:
        las.x[:2] = las.x[:2] + np.array([9e5, -8e5])

    plain = extract_ground(inputs[0], tmp_path / "plain.laz", pdal=any_pdal())
    found = extract_ground(write(pair, tmp_path / "far.las", move), tmp_path / "far.laz", pdal=any_pdal())
    assert found.outliers - plain.outliers in (1, 2)
    # the slope's plane is another by a hair, and with it where windows begin
    assert abs(found.ground_points - plain.ground_points) < 0.015 * plain.ground_points
    assert found.roi_area == pytest.approx(plain.roi_area, rel=0.01)


def test_feet_give_the_same_ground_in_metres(pair, result, inputs, tmp_path):
    foot = 0.3048

    cloud = pair.first
    header = laspy.LasHeader(point_format=6, version="1.4")
    header.scales, header.offsets = [0.001 / foot] * 3, np.floor(cloud.xyz.mean(axis=0)) / foot
    header.add_crs(CRS.from_epsg(2222))
    las = laspy.LasData(header)
    las.x, las.y, las.z = cloud.xyz.T / foot
    las.return_number, las.number_of_returns = cloud.return_number, cloud.number_of_returns
    las.write(tmp_path / "feet.las")
    metres = CRS.from_user_input(extract_crs(tmp_path / "feet.las"))
    geopandas.GeoSeries([shapely.Polygon(pair.roi)], crs=metres).to_file(tmp_path / "roi.gpkg")
    found = extract_ground(tmp_path / "feet.las", tmp_path / "g.laz", roi=tmp_path / "roi.gpkg", pdal=any_pdal())
    assert any("feet" in w for w in found.warnings)
    assert abs(found.ground_points - result.ground_points) < 0.002 * result.ground_points
    one, other = (np.sort(np.array(laspy.read(r.ground).xyz), axis=0) for r in (found, result))
    assert np.abs(one.mean(axis=0) - other.mean(axis=0)).max() < 0.01


def extract_crs(path: Path) -> CRS:
    from slopewatch.engine.pointcloud.reading import open_cloud

    return open_cloud(path)[1].crs


def test_the_published_profile_is_the_plain_filter(pair, inputs, tmp_path):
    parameters = GroundParameters.build(profile="paper")
    found = extract_ground(inputs[0], tmp_path / "g.laz", roi=inputs[1], parameters=parameters, pdal=old_pdal())
    las = laspy.read(found.clipped)
    plain = module.cloth_ground(np.array(las.xyz), parameters)
    assert set(laspy.read(found.ground).gps_time) == set(las.gps_time[plain])


def test_return_numbers_that_make_no_sense_are_said(pair, inputs, tmp_path):
    def clear(las: laspy.LasData) -> None:
        las.return_number, las.number_of_returns = (np.zeros(len(las.x), np.uint8) for _ in range(2))

    progress = Progress()
    cloud = write(pair, tmp_path / "zeros.las", clear)
    found = extract_ground(cloud, tmp_path / "g.laz", roi=inputs[1], pdal=any_pdal(), progress=progress)
    assert found.ground_ratio > 0.2
    assert any("return" in w for w in progress.warnings)
    assert progress.warnings == list(found.warnings)


def test_a_cloth_finer_than_the_points_is_said(pair, inputs, tmp_path):
    def thin(las: laspy.LasData) -> None:
        las.points = las.points[np.arange(0, len(las.x), 400)]

    cloud = write(pair, tmp_path / "thin.las", thin)
    found = extract_ground(cloud, tmp_path / "g.laz", pdal=any_pdal())
    assert any("cloth_resolution" in w for w in found.warnings)
    assert found.spacing > 0.5


def test_a_file_that_names_its_noise_and_uses_classes_above_31(pair, inputs, result, tmp_path):
    def label(las: laspy.LasData) -> None:
        labels = np.full(len(las.x), 65, np.uint8)
        labels[np.flatnonzero(las.user_data)[::100]] = 18
        labels[np.flatnonzero(las.user_data)[1::100]] = 2
        las.classification = labels

    found = extract_ground(write(pair, tmp_path / "c.las", label), tmp_path / "g.laz", roi=inputs[1], pdal=any_pdal())
    las = laspy.read(found.clipped)
    assert set(np.asarray(las.classification)) <= {2, 65}
    taken = set(laspy.read(result.clipped).gps_time) - set(las.gps_time)
    assert len(taken) == found.outliers - result.outliers > 50
    ground = set(laspy.read(found.ground).gps_time)
    assert len(ground ^ (set(laspy.read(result.ground).gps_time) - taken)) < 0.005 * len(ground)


def broken_inputs() -> dict[str, tuple[Callable[[Path, SimulatedPair, tuple[Path, Path]], dict[str, object]], str]]:
    def far(folder: Path, pair: SimulatedPair, inputs: tuple[Path, Path]) -> dict[str, object]:
        square = shapely.box(10_000, 10_000, 10_050, 10_050)
        geopandas.GeoSeries([square], crs=pair.crs).to_file(folder / "far.gpkg")
        return {"cloud": inputs[0], "roi": folder / "far.gpkg"}

    def tiny(folder: Path, pair: SimulatedPair, inputs: tuple[Path, Path]) -> dict[str, object]:
        centre = shapely.Polygon(pair.roi).centroid
        geopandas.GeoSeries([centre.buffer(0.05)], crs=pair.crs).to_file(folder / "tiny.gpkg")
        return {"cloud": inputs[0], "roi": folder / "tiny.gpkg"}

    def line(folder: Path, pair: SimulatedPair, inputs: tuple[Path, Path]) -> dict[str, object]:
        def squeeze(las: laspy.LasData) -> None:
            las.points = las.points[:1000]
            las.x = las.y - las.header.offsets[1] + las.header.offsets[0]
            las.z = np.full(1000, 5.0)

        return {"cloud": write(pair, folder / "line.las", squeeze)}

    def few(folder: Path, pair: SimulatedPair, inputs: tuple[Path, Path]) -> dict[str, object]:
        def cut(las: laspy.LasData) -> None:
            las.points = las.points[:5]

        return {"cloud": write(pair, folder / "few.las", cut)}

    def strict(folder: Path, pair: SimulatedPair, inputs: tuple[Path, Path]) -> dict[str, object]:
        return {"cloud": inputs[0], "parameters": GroundParameters(minimum_ground_ratio=0.99)}

    def huge(folder: Path, pair: SimulatedPair, inputs: tuple[Path, Path]) -> dict[str, object]:
        def move(las: laspy.LasData) -> None:
            las.x[:3] = las.x[:3] + 9e5

        cloud = write(pair, folder / "huge.las", move)
        return {"cloud": cloud, "parameters": GroundParameters(denoise=False, slope_aligned=False)}

    def degrees(folder: Path, pair: SimulatedPair, inputs: tuple[Path, Path]) -> dict[str, object]:
        return {"cloud": inputs[0], "inputs": InputParameters(crs="EPSG:4326")}

    return {
        "region outside": (far, "outside"),
        "region without points": (tiny, r"survey\.las.* within the region.*too few"),
        "on a line": (line, "line"),
        "few points": (few, "too few"),
        "implausible share": (strict, "too few to be true"),
        "cloth too large": (huge, "cloth_resolution"),
        "degrees": (degrees, "geographic"),
    }


@pytest.mark.parametrize("case", broken_inputs())
def test_what_cannot_work_is_one_sentence_and_leaves_nothing(pair, inputs, tmp_path, case):
    make, message = broken_inputs()[case]
    given = make(tmp_path, pair, inputs)
    cloud = given.pop("cloud")
    (tmp_path / "out").mkdir()
    with pytest.raises(InputError, match=message) as caught:
        extract_ground(cloud, tmp_path / "out" / "g.laz", pdal=any_pdal(), **given)
    assert "\n" not in str(caught.value)
    assert str(caught.value).endswith(".")
    assert list((tmp_path / "out").iterdir()) == []


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
json.dump({{"stages": {{}}}}, open(sys.argv[sys.argv.index("--metadata") + 1], "w"))
'''


@pytest.mark.parametrize("parameters", [{}, {"slope_aligned": False}, {"refine": False, "class_threshold": 0.1}])
def test_the_cloth_laid_by_pdal_gives_the_same_ground(inputs, tmp_path, monkeypatch, parameters):
    """The path for PDAL 2.3 and later, whose filters.csf is played by a stand-in that follows its documentation."""
    real = any_pdal()
    if real.path is None:
        pytest.skip("the stand-in passes other pipelines on to the pdal program")
    monkeypatch.delenv("SLOPEWATCH_PDAL", raising=False)  # the machine's choice would come before the stand-in
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


@pytest.mark.parametrize(
    ("name", "recall", "precision"),
    [
        ("alpine_slope", 0.5, 0.9),
        ("test_data_77050_627755_LA93_IGN69", 0.95, 0.98),
        ("test_data_77050_627760_LA93_IGN69", 0.94, 0.98),
    ],
)
def test_ground_of_real_clouds_is_the_vendors(shared_data, tmp_path, name, recall, precision):
    cloud = shared_data / "real" / "ign_tiles" / f"{name}.laz"
    found = extract_ground(cloud, tmp_path / "g.laz", pdal=any_pdal())
    raw = laspy.read(cloud)
    vendor = rows_of(raw, np.asarray(raw.classification) == 2)
    own = rows_of(laspy.read(found.ground))
    assert len(vendor & own) / len(vendor) > recall
    assert len(vendor & own) / len(own) > precision


def rows_of(las: laspy.LasData, chosen: np.ndarray | None = None) -> set[tuple[int, ...]]:
    chosen = np.ones(len(las.x), bool) if chosen is None else chosen
    return set(zip(*(np.asarray(las[n])[chosen].tolist() for n in ("X", "Y", "Z")), strict=True))


def test_a_real_jungle_slope(shared_data, tmp_path):
    found = extract_ground(
        shared_data / "real" / "ign_tiles" / "sample_lareunion_epsg2975.laz", tmp_path / "g.laz", pdal=any_pdal()
    )
    # hardly a pulse reaches the ground, and plants are not taken for it
    assert 0.002 < found.ground_ratio < 0.02
    assert any("no ground" in w or "below its ground" in w for w in found.warnings)
    assert 20 < found.plane_dip < 40
    assert found.vegetation_cover > 0.8
    # nearly nothing lies more than half a metre below what was found
    las, ground = laspy.read(found.clipped), laspy.read(found.ground)
    from scipy.spatial import cKDTree

    distance, nearest = cKDTree(np.array(ground.xyz)[:, :2]).query(np.array(las.xyz)[:, :2])
    below = (las.z - np.array(ground.z)[nearest] < -0.5) & (distance < 0.3)
    assert below.mean() < 0.002


RUN = """
import sys
from pathlib import Path
sys.path.insert(0, {tests!r})
import conftest
from slopewatch.engine.core import cancellation
from slopewatch.engine.core.staged_outputs import staged_outputs
from slopewatch.engine.ground.extraction import extract_ground
from slopewatch.interface.parameters import GroundParameters
cancellation.install(lambda: None, watch_parent=False)
parameters = GroundParameters(cloth_resolution=0.02, iterations=10000)
with staged_outputs(Path({folder!r})) as stage:
    print("start", flush=True)
    extract_ground(Path({cloud!r}), stage.path("g.laz"), parameters=parameters)
"""


@pytest.mark.skipif(os.name != "posix", reason="signals")
def test_cancelling_leaves_nothing(inputs, tmp_path):
    any_pdal()
    tests = str(Path(__file__).resolve().parents[2])
    script = RUN.format(tests=tests, folder=str(tmp_path / "out"), cloud=str(inputs[0]))
    environment = {**os.environ, "TMPDIR": str(tmp_path)}
    process = subprocess.Popen([sys.executable, "-c", script], stdout=subprocess.PIPE, text=True, env=environment)
    assert process.stdout is not None
    assert process.stdout.readline() == "start\n"
    deadline = time.monotonic() + PATIENCE_S
    while not list(tmp_path.glob("slopewatch-csf-*/parameters.json")):
        assert process.poll() is None
        assert time.monotonic() < deadline
        time.sleep(0.05)
    started = time.monotonic()
    process.send_signal(signal.SIGINT)
    assert process.wait(PATIENCE_S) == 130
    assert time.monotonic() - started < CANCELLED_S
    process.communicate()
    assert list(tmp_path.iterdir()) == []
