"""Epochs that do not go together, and odd parameters: refused in one sentence before anything is written, or said.

Numbered as the list of bad inputs. What other files test already and is not repeated here:
26 cli/test_commands.py (other crs, inspect in two systems), workflows/test_m3c2.py (test_reference_systems),
    workflows/test_series.py
27 refusals/test_damaged_clouds.py (test_27), engine/crs/test_working_frame.py,
    engine/ground/test_extraction.py (test_feet_give_the_same...), workflows/test_m3c2.py
28, 29 engine/change/test_judgement.py (test_heights_of_two_systems_are_no_deformation),
    engine/zones/test_confirmation.py, workflows/test_m3c2.py
30 engine/change/test_difference.py, workflows/test_m3c2.py, workflows/test_series.py, cli/test_commands.py (no overlap)
31 accuracy/test_registration_limits.py (test_a_tiny_overlap_is_told_and_an_overlap_of_nothing_refused)
32, 33 engine/epochs/test_epoch.py, engine/epochs/test_manifest.py, workflows/test_m3c2.py,
    cli/test_commands.py (same content, reversed, bad date)
34, 35, 36 engine/vector/test_area.py, engine/ground/test_extraction.py (region outside; a region in another system)
38 accuracy/test_registration_limits.py (three tests), engine/change/test_judgement.py (test_without_stable_ground...)
39 refusals/test_damaged_clouds.py (test_39), engine/pointcloud/test_returns.py,
    engine/ground/test_extraction.py (test_return_numbers_that_make_no_sense_are_said)
47 engine/grid/test_geotiff.py (test_raster_is_what_the_contract_says)
48 interface/parameters/test_groups.py, cli/test_commands.py (bad number, nan, options that are not understood)
"""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from datetime import date
from pathlib import Path

import geopandas
import laspy
import numpy as np
import pytest
import rasterio
import shapely
from click.testing import CliRunner
from pyproj import CRS
from scipy.spatial.transform import Rotation
from slopewatch.cli.program import cli
from slopewatch.engine.change.difference import difference
from slopewatch.engine.change.doubts import warn_of_doubtful_change
from slopewatch.engine.core import cancellation
from slopewatch.engine.core.errors import InputError
from slopewatch.engine.core.progress import Progress
from slopewatch.engine.epochs.comparability import refuse_other_raw_heights, require_comparable
from slopewatch.engine.epochs.epoch import Epoch
from slopewatch.engine.epochs.height_systems import compare_clouds, disagreement
from slopewatch.engine.grid.geotiff import read_raster
from slopewatch.engine.ground import extraction
from slopewatch.engine.pointcloud.pdal_program import find_pdal
from slopewatch.engine.pointcloud.reading import read_cloud
from slopewatch.engine.report.compose import write_report
from slopewatch.interface.parameters import (
    ChangeParameters,
    DistanceParameters,
    GridChangeParameters,
    GroundParameters,
    InputParameters,
    RegistrationParameters,
    ReportParameters,
    SeriesParameters,
)
from slopewatch.workflows import inspect as inspection
from slopewatch.workflows.change import change_step
from slopewatch.workflows.ground import ground_step
from slopewatch.workflows.inspect import inspect_slope
from slopewatch.workflows.m3c2 import m3c2_step
from slopewatch.workflows.register import register_step
from slopewatch.workflows.series import monitor_series
from slopewatch.workflows.settings import DistanceSettings, SeriesSettings, Settings

X, Y = 500_000.0, 3_500_000.0
SIDE = 12.0
COARSE = ChangeParameters(cell=0.5)
ONE_SIZE = GridChangeParameters(cell=0.5)
AS_SURVEYED = RegistrationParameters(method="none")
FOOT = 1200 / 3937


def slope(seed: int, points: int = 6000) -> np.ndarray:
    """A slope of 31 degrees with relief, 12 x 12 m."""
    rng = np.random.default_rng(seed)
    u, v = rng.uniform(0, SIDE, (2, points))
    z = 50 + 0.6 * v + 0.3 * np.sin(0.9 * u) + 0.25 * np.sin(1.1 * v + 0.4 * u) + rng.normal(0, 0.01, points)
    return np.column_stack([X + u, Y + v, z])


def write(path: Path, xyz: np.ndarray, crs: object = 32651) -> Path:
    header = laspy.LasHeader(point_format=6, version="1.4")
    header.scales, header.offsets = [0.001] * 3, np.floor(xyz[0])
    header.add_crs(CRS.from_user_input(crs))
    las = laspy.LasData(header)
    las.x, las.y, las.z = xyz.T
    las.return_number = las.number_of_returns = np.ones(len(xyz), dtype=np.uint8)
    las.classification = np.full(len(xyz), 2)
    las.write(path)
    return path


@pytest.fixture
def first(tmp_path) -> Path:
    return write(tmp_path / "2024-05-01.laz", slope(1))


def refused(folder: Path, work, *words: str) -> str:
    """The one sentence with which ``work`` is refused; it holds ``words`` and leaves ``folder`` as it was."""
    before = {p: p.stat().st_mtime_ns for p in folder.rglob("*")}
    with pytest.raises(InputError) as caught:
        work()
    assert caught.value.exit_code == 2
    sentence = str(caught.value)
    assert "\n" not in sentence
    assert sentence.endswith(".")
    for word in words:
        assert word in sentence, sentence
    assert {p: p.stat().st_mtime_ns for p in folder.rglob("*")} == before, "something was left behind"
    return sentence


def register(reference: Path, moving: Path, progress: Progress | None = None, *, inputs=None, **parameters):
    settings = Settings(inputs=inputs or InputParameters(), registration=RegistrationParameters(**parameters))
    folder = reference.parent
    return register_step(
        reference,
        moving,
        folder / "aligned.laz",
        settings,
        transform_path=folder / "transform.json",
        given=None,
        invert=False,
        stable=None,
        progress=progress or Progress(),
    )


def change(reference: Path, moving: Path, progress: Progress | None = None):
    return change_step(
        reference,
        moving,
        reference.parent / "out",
        Settings(change=COARSE, report=ReportParameters(zone_profiles=0)),
        dates=("2024-05-01", "2025-05-01"),
        transform_path=None,
        progress=progress or Progress(),
    )


def m3c2(reference: Path, moving: Path, progress: Progress | None = None, output: Path | None = None):
    return m3c2_step(
        reference,
        moving,
        output or reference.parent / "points.laz",
        DistanceSettings(InputParameters(), DistanceParameters(distance_cell=0.5)),
        raster_dir=None,
        core=None,
        dates=("2024-05-01", "2025-05-01"),
        transform_path=None,
        progress=progress or Progress(),
    )


def series(folder: Path, *clouds: Path, progress: Progress | None = None, **options):
    epochs = [Epoch(path, date(2024 + n, 5, 1)) for n, path in enumerate(clouds)]
    settings = SeriesSettings(series=SeriesParameters(ground_ready=True), change=ONE_SIZE, registration=AS_SURVEYED)
    return monitor_series(epochs, folder / "out", settings, progress=progress, **options)


def inspect(folder: Path, *epochs: Epoch, **options):
    return inspect_slope(epochs, folder / "out", Settings(), **options)


def region(path: Path, geometry: shapely.Geometry, crs: object = 32651) -> Path:
    geopandas.GeoDataFrame(geometry=[geometry], crs=32651).to_crs(crs).to_file(path)
    return path


def test_26_other_reference_systems_are_refused_and_a_wrong_one_can_be_overridden(first):
    other = write(first.with_name("2025-05-01.laz"), slope(2), 32650)
    words = ("2024-05-01.laz in WGS 84 / UTM zone 51N", "2025-05-01.laz in WGS 84 / UTM zone 50N", "--crs")
    refused(first.parent, lambda: register(first, other), *words)
    refused(first.parent, lambda: inspect(first.parent, Epoch(first, None), Epoch(other, None)), *words)
    progress = Progress()
    outputs = register(first, other, progress, inputs=InputParameters(crs="EPSG:32651"), method="none").outputs
    assert laspy.read(outputs["aligned"]).header.parse_crs().to_epsg() == 32651
    record = json.loads(outputs["run"].read_text())
    assert any("zone 50N; the given" in note for note in read_cloud(other, InputParameters(crs="EPSG:32651")).notes)
    assert record["parameters"]["inputs"]["crs"] == "EPSG:32651"


@pytest.mark.parametrize(
    ("systems", "told"), [(("32651+5773", "32651+3855"), "EGM96"), (("32651", "32651+5773"), "none")]
)
def test_26_28_declared_height_systems_that_differ_are_named(tmp_path, systems, told):
    a, b = (write(tmp_path / f"{n}.laz", slope(n), f"EPSG:{system}") for n, system in enumerate(systems))
    refused(tmp_path, lambda: m3c2(a, b), "different height systems", f"0.laz {told}", "1.laz EGM", "--crs")
    require_comparable(a, b, InputParameters(crs="EPSG:32651+5773"))


def test_27_feet_and_metres_are_compared_in_metres(tmp_path):
    """The same system in feet and in metres; the western third sank by 30 cm."""
    place = np.array([1_500_000.0, -3_000_000.0, 0.0])
    before, after = slope(1) + place, slope(2) + place
    west = after[:, 0] - X - place[0] < 4
    after[west, 2] -= 0.3
    a = write(tmp_path / "metres.laz", before, 26943)
    b = write(tmp_path / "feet.laz", after / FOOT, 2227)
    require_comparable(a, b, InputParameters())
    clouds = [read_cloud(path) for path in (a, b)]
    assert sum("US survey feet" in note for note in clouds[1].notes) == 2
    found = difference(clouds[0].xyz, clouds[1].xyz, COARSE)
    middle = found.grid.west + (np.arange(found.grid.columns) + 0.5) * 0.5 - X - place[0]
    assert np.nanmedian(found.dz[:, middle < 3.5]) == pytest.approx(-0.3, abs=0.01)
    assert np.nanmedian(found.dz[:, middle > 4.5]) == pytest.approx(0.0, abs=0.01)


@pytest.mark.parametrize("work", [register, change, m3c2])
@pytest.mark.parametrize("factor", [1 / 0.3048, 0.3048])
def test_27_heights_in_feet_that_no_system_declares(first, work, factor):
    other = write(first.with_name("2025-05-01.laz"), slope(2) * [1, 1, factor])
    words = ("2025-05-01.laz are", f"{factor:.3f} times those of 2024-05-01.laz", "feet", "convert")
    refused(first.parent, lambda: work(first, other), *words)


@pytest.mark.parametrize("offset", [20.0, 27.3, -35.0])
@pytest.mark.parametrize("work", ["robust", "icp", "none", "m3c2", "series"])
def test_28_ellipsoidal_against_orthometric_heights(first, work, offset):
    """With the tilt of a geoid, 4 cm over the slope."""
    xyz = slope(2)
    xyz[:, 2] += offset + 0.04 * (xyz[:, 0] - X) / SIDE
    other = write(first.with_name("2025-05-01.laz"), xyz)
    run = {"m3c2": lambda: m3c2(first, other), "series": lambda: series(first.parent, first, other)}
    words = (f"about {abs(offset):.1f} m {'above' if offset > 0 else 'below'} 2024-05-01.laz over the whole overlap",)
    words += ("2025-05-01.laz", "ellipsoidal against orthometric heights", "same system")
    sentence = refused(first.parent, run.get(work, lambda: register(first, other, method=work)), *words)
    assert "overlap:" in sentence
    assert "do not overlap" not in sentence


def planted(seed: int, tall: float) -> np.ndarray:
    """``slope`` under plants: of nine tenths of the points each lies up to ``tall`` metres higher."""
    xyz = slope(seed, 60_000)
    rng = np.random.default_rng(seed + 100)
    xyz[:, 2] += rng.uniform(0, tall, len(xyz)) * (rng.uniform(size=len(xyz)) < 0.9)
    return xyz


@pytest.mark.parametrize(
    ("later", "words"),
    [
        (planted(2, 4.0) + [0, 0, 27.3], "about 27.3 m above 2024-05-01.laz over the whole overlap"),
        (planted(2, 4.0) * [1, 1, 0.3048], "0.305 times those of 2024-05-01.laz"),
    ],
    ids=["another height system", "feet"],
)
def test_27_and_28_are_told_by_an_inspection_before_the_ground_is_extracted(tmp_path, monkeypatch, later, words):
    def never(*_, **__):
        raise AssertionError("the ground was extracted")

    monkeypatch.setattr(inspection, "extract_ground", never)
    clouds = [write(tmp_path / "2024-05-01.laz", planted(1, 4.0)), write(tmp_path / "2025-05-01.laz", later)]
    epochs = [Epoch(path, date(2024 + n, 5, 1)) for n, path in enumerate(clouds)]
    refused(tmp_path, lambda: inspect(tmp_path, *epochs), "2025-05-01.laz", words)


@pytest.mark.parametrize("parameters", [{}, {"method": "icp"}])
def test_28_plants_that_were_cut_and_what_registration_takes_off_are_not_told_too_early(tmp_path, parameters):
    first = write(tmp_path / "a.laz", planted(1, 12.0))
    for later in (planted(2, 0.5), planted(2, 12.0) + [0, 0, 4.0]):
        other = write(tmp_path / "b.laz", later)
        refuse_other_raw_heights(first, other, InputParameters(), RegistrationParameters(**parameters))
    other = write(tmp_path / "b.laz", planted(2, 12.0) + [0, 0, 20.0])
    with pytest.raises(InputError, match=r"about 20\.\d m above"):
        refuse_other_raw_heights(first, other, InputParameters(), RegistrationParameters(**parameters))
    wide = RegistrationParameters(maximum_offset=25.0, **parameters)
    refuse_other_raw_heights(first, other, InputParameters(), wide)


def test_28_the_registration_takes_the_offset_off_where_that_is_asked_for(first):
    other = write(first.with_name("2025-05-01.laz"), slope(2) + [0, 0, 27.3])
    sentence = refused(first.parent, lambda: register(first, other), "maximum_offset of 29 m")
    assert sentence.count("29") == 1
    progress = Progress()
    outputs = register(first, other, progress, maximum_offset=29.0).outputs
    assert np.abs(laspy.read(outputs["aligned"]).xyz - slope(2)).max() < 0.03
    assert any("check its datum and heights" in warning for warning in progress.warnings)


def test_28_what_moved_is_not_taken_for_another_height_system():
    before, after = slope(1), slope(2)
    fallen = after.copy()
    fallen[fallen[:, 1] < Y + 8, 2] -= 5.0
    rotated = Rotation.from_euler("x", 30, degrees=True).apply(after - after.mean(axis=0)) + after.mean(axis=0)
    lowered = after - np.outer(2.0 + 6.0 * (after[:, 0] - X) / SIDE, [0, 0, 1])
    for moved in (after, after + [0.4, -0.3, 0.9], fallen, rotated, lowered):
        assert disagreement(compare_clouds(before, moved), "a", "b", 3.0) is None
    assert compare_clouds(before, after + [100.0, 0, 0]) is None
    assert compare_clouds(before[:10], after) is None
    assert "50" not in str(disagreement(compare_clouds(before, after + [0, 0, 60.0]), "a", "b", 3.0))


@pytest.fixture(scope="module")
def risen(tmp_path_factory) -> tuple[Path, list[str]]:
    """The outputs of a change between surveys one of which lies 40 cm higher, and the warnings. It has gaps."""
    folder = tmp_path_factory.mktemp("risen")
    clouds = []
    for seed, lift in ((1, 0.0), (2, 0.4)):
        xyz = slope(seed)
        xyz = xyz[np.hypot(xyz[:, 0] - X - 6, xyz[:, 1] - Y - 6) > 2]
        clouds.append(write(folder / f"202{seed}-05-01.laz", xyz + [0, 0, lift]))
    progress = Progress()
    change(*clouds, progress)
    m3c2(*clouds, output=folder / "out" / "points.laz")
    return folder / "out", progress.warnings


def test_29_a_uniform_dz_is_named_and_no_zone(risen):
    out, warnings = risen
    assert any("whole overlap has risen by about 0.40" in w and "no zones are drawn" in w for w in warnings)
    assert len(geopandas.read_file(out / "zones.gpkg", layer="zones")) == 0
    assert json.loads((out / "run.json").read_text())["metrics"]["zone_count"] == 0


@pytest.mark.filterwarnings("error")
def test_29_a_uniform_dz_that_is_left_has_figures_all_the_same(first):
    """Nothing agrees, as all lies 40 cm higher and registration is off."""
    other = write(first.with_name("2025-05-01.laz"), slope(2) + [0, 0, 0.4])
    metrics = register(first, other, method="none").figures
    assert metrics["registration_stable_share"] == 0
    assert metrics["registration_normal_translation_m"] == 0
    assert metrics["registration_error_m"] > 0.3


@pytest.mark.parametrize("work", [register, change, m3c2])
def test_30_no_overlap_names_both_extents(first, work):
    other = write(first.with_name("2025-05-01.laz"), slope(2) + [300, 0, 0])
    refused(first.parent, lambda: work(first, other), "do not overlap", "500000.0", "500012.0", "500300.0", "500312.0")


def test_31_a_tiny_overlap_is_said():
    progress = Progress()
    warn_of_doubtful_change(difference(slope(1), slope(2) + [10.0, 0, 0], COARSE), progress)
    (sentence,) = [w for w in progress.warnings if "could be compared" in w]
    assert "check that both cover the same slope" in sentence or "cells of" in sentence


@pytest.mark.parametrize("name", ["2024-05-01.laz", "2025-05-01.laz", "another name.laz"])
def test_32_the_same_cloud_twice(first, name):
    folder = first.parent
    other = first.with_name(name)
    if other != first:
        shutil.copy(first, other)
    word = "both clouds" if other == first else "same cloud"
    refused(folder, lambda: register(first, other), word, first.name)
    pair = Epoch(first, date(2024, 5, 1)), Epoch(other, date(2025, 5, 1))
    refused(folder, lambda: inspect(folder, *pair), "same cloud", name, "two different epochs")
    refused(folder, lambda: series(folder, first, other), "same cloud", name)


@pytest.mark.parametrize(("days", "word"), [((2, 1), "reversed order"), ((1, 1), "same date")])
def test_33_dates_reversed_or_equal(first, days, word):
    folder = first.parent
    other = write(folder / "other.laz", slope(2))
    epochs = [Epoch(path, date(2024, 5, day)) for path, day in zip((first, other), days, strict=True)]
    refused(folder, lambda: inspect(folder, *epochs), word, "2024-05-01")
    refused(folder, lambda: monitor_series(epochs, folder / "out"), word, "2024-05-01")


def any_pdal() -> None:
    try:
        find_pdal()
    except InputError as error:
        pytest.skip(f"no PDAL: {error}")


def test_34_a_region_outside_of_the_clouds(first):
    any_pdal()
    other = write(first.with_name("2025-05-01.laz"), slope(2))
    area = region(first.with_name("roi.gpkg"), shapely.box(X + 500, Y, X + 520, Y + 20))
    pair = Epoch(first, date(2024, 5, 1)), Epoch(other, date(2025, 5, 1))
    words = ("roi.gpkg", "outside of the cloud", "x 500500.0 to 500520.0", "x 500000.0 to 500012.0", "check the area")
    refused(first.parent, lambda: inspect(first.parent, *pair, roi=area), *words)


@pytest.fixture(scope="module")
def watched(tmp_path_factory) -> tuple[Path, list[str]]:
    """A series within a region that crosses itself and is in degrees; its outputs and warnings."""
    folder = tmp_path_factory.mktemp("series")
    clouds = [write(folder / f"{n}.laz", slope(n)) for n in (1, 2)]
    bow_tie = shapely.Polygon([(X, Y), (X + SIDE, Y + SIDE), (X + SIDE, Y), (X, Y + SIDE)])
    progress = Progress()
    series(folder, *clouds, progress=progress, roi=region(folder / "roi.geojson", bow_tie, 4326))
    return folder / "out", progress.warnings


def test_35_a_region_that_crosses_itself_is_repaired_and_said(watched):
    out, warnings = watched
    assert any("roi.geojson" in w and "crosses itself; it was repaired" in w for w in warnings)
    dz = read_raster(next((out / "cumulative").glob("*change*.tif"))).array
    # both triangles of the bow tie, west and east of the crossing
    assert np.isfinite(dz[:, :8]).sum() > 50
    assert np.isfinite(dz[:, -8:]).sum() > 50


def test_36_a_region_in_another_system_is_transformed(watched):
    out, warnings = watched
    assert any("roi.geojson" in w and "was transformed from WGS 84 to" in w for w in warnings)
    found = read_raster(next((out / "cumulative").glob("*change*.tif")))
    rows, columns = np.nonzero(np.isfinite(found.array))
    u = found.grid.west + (columns + 0.5) * 0.5 - X
    v = found.grid.north - (rows + 0.5) * 0.5 - Y
    assert (np.abs(u - 6) >= np.abs(v - 6)).all(), "north and south of the crossing there is no region"
    assert len(u) > 0.6 * 2 * SIDE**2 / 4 / 0.25


def test_37_no_ground_found(tmp_path, monkeypatch):
    """A closed crown over a dozen points; then a surface of which the refinement leaves nothing."""
    any_pdal()
    crown = slope(1) + [0, 0, 15]
    crown[:, 2] += np.random.default_rng(0).uniform(0, 8, len(crown))
    cloud = write(tmp_path / "crown.laz", np.vstack([crown, slope(2, 5)]))
    settings = Settings(ground=GroundParameters(denoise=False))

    def work():
        return ground_step(cloud, tmp_path / "g.laz", settings, roi=None, pdal=None, progress=Progress())

    refused(tmp_path, work, "of 6005 points", "crown.laz", "too few to be true", "check the units", "outliers")
    plain = extraction.refined

    def nothing(*arguments, **options):
        found = plain(*arguments, **options)
        return replace(found, ground=np.zeros_like(found.ground))

    monkeypatch.setattr(extraction, "refined", nothing)
    refused(tmp_path, work, "No ground was found in", "crown.laz", "check the units of its heights and its region")


def test_38_no_stable_ground_is_refused_or_accepted_with_a_wide_level(first):
    """Every square metre rose or sank by up to a metre, each its own way."""
    xyz = slope(2)
    steps = np.random.default_rng(8).uniform(-1.0, 1.0, (12, 12))
    xyz[:, 2] += steps[(xyz[:, 0] - X).astype(int), (xyz[:, 1] - Y).astype(int)]
    other = write(first.with_name("2025-05-01.laz"), xyz)
    with pytest.raises(InputError, match="--accept-unstable"):
        register(first, other)
    progress = Progress()
    done = register(first, other, progress, accept_unstable=True)
    outputs, metrics = done.outputs, done.figures
    assert any("No stable ground was found" in w and "give an area known to be stable" in w for w in progress.warnings)
    assert np.array_equal(json.loads(outputs["transform"].read_text())["matrix"], np.eye(4))
    error = metrics["registration_error_m"]
    assert error > 0.2
    wide, narrow = (difference(slope(1), xyz, COARSE, registration_error=e).median_level for e in (error, 0.0))
    assert wide == pytest.approx(np.hypot(1.96 * error, narrow), rel=0.3)


def test_47_every_raster_has_no_nan_and_says_its_nodata(risen, watched):
    rasters = [path for out, _ in (risen, watched) for path in sorted(out.rglob("*.tif"))]
    assert {"elevation_change.tif", "surface_heights.tif", "m3c2_distance.tif"} <= {p.name for p in rasters}
    gaps = 0
    for path in rasters:
        with rasterio.open(path) as source:
            if source.dtypes[0] == "uint8":
                continue  # a picture, with transparency
            assert set(source.nodatavals) == {-9999.0}, path.name
            values = source.read()
            assert np.isfinite(values).all(), path.name
            gaps += np.count_nonzero(values == -9999.0)
    assert gaps > 100


@pytest.mark.parametrize("declared", [-9999.0, float("nan"), None])
def test_47_readers_take_nan_and_9999_for_no_data(risen, tmp_path, declared):
    """As another program leaves a raster behind: some gaps NaN, others -9999."""
    out, _ = risen
    for path in (p for p in out.iterdir() if p.suffix in (".tif", ".json", ".gpkg", ".csv", ".png")):
        shutil.copy(path, tmp_path)
    changed = 0
    for path in sorted(tmp_path.glob("*.tif")):
        expected = read_raster(path).array
        with rasterio.open(path) as source:
            profile, values = source.profile, source.read()
            texts = source.descriptions, source.units, source.tags()
        if values.dtype != np.float32:
            continue
        gaps = np.argwhere(values == -9999.0)
        values[tuple(gaps[::2].T)] = np.nan
        changed += len(gaps)
        with rasterio.open(path, "w", **{**profile, "driver": "GTiff", "nodata": declared}) as target:
            target.write(values)
            target.descriptions, target.units = texts[0], texts[1]
            target.update_tags(**texts[2])
        assert np.array_equal(read_raster(path).array, expected, equal_nan=True), path.name
    assert changed > 100
    page = write_report(tmp_path).read_text(encoding="utf-8")
    assert page == (out / "report.html").read_text(encoding="utf-8")


OPTIONS = [
    (["register", "a.laz", "b.laz", "--output", "c.laz", "--maximum-offset", "nan"], "maximum_offset is nan"),
    (["register", "a.laz", "b.laz", "--output", "c.laz", "--registration-voxel", "-1"], "registration_voxel is -1"),
    (["register", "a.laz", "b.laz", "--output", "c.laz", "--method", "best"], "'--method'"),
    (["change", "a.laz", "b.laz", "--output-dir", "out", "--cell", "inf"], "cell is inf"),
    (["change", "a.laz", "b.laz", "--output-dir", "out", "--confidence", "95"], "confidence is 95"),
    (["change", "a.laz", "b.laz", "--output-dir", "out", "--minimum-points", "1.5"], "'--minimum-points'"),
    (["change", "a.laz", "b.laz", "--output-dir", "out", "--cel-size", "1"], "--cel-size"),
    (["m3c2", "a.laz", "b.laz", "--output", "c.laz", "--normal-scale", "-0.5"], "normal_scale is -0.5"),
    (["m3c2", "a.laz", "b.laz", "--output", "c.laz", "--half-length", "nan"], "half_length is nan"),
    (["series", "folder", "--output-dir", "out", "--cell", "wide"], "'--cell'"),
    (["series", "folder", "--output-dir", "out", "--cell", "-1"], "cell is -1"),
    (
        ["inspect", "--epoch", "2024-05-01=a.laz", "--output-dir", "out", "--cloth-resolution", "nan"],
        "cloth_resolution",
    ),
    (["inspect", "--epoch", "1 May=a.laz", "--output-dir", "out"], "YYYY-MM-DD"),
    (["ground", "a.laz", "--output", "g.laz", "--rigidness", "7"], "rigidness is 7"),
    (["ground", "a.laz", "--output", "g.laz", "--profile", "mine"], "'--profile'"),
]


@pytest.mark.parametrize(("arguments", "word"), OPTIONS, ids=[" ".join(a[-2:]) for a, _ in OPTIONS])
def test_48_malformed_parameters_are_refused_before_any_work(arguments, word, tmp_path, monkeypatch):
    """The clouds do not even exist: the parameter is named, not they."""
    monkeypatch.setattr(cancellation, "install", lambda *_, **__: None)
    monkeypatch.chdir(tmp_path)
    done = CliRunner().invoke(cli, arguments)
    assert done.exit_code == 2
    sentence = done.stderr.strip().splitlines()[-1]
    assert sentence.startswith("Error: ")
    assert sentence.endswith((".", "?)"))  # (Did you mean '--cell'?)
    assert word in sentence
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("value", [float("nan"), -1.0, "wide", None, True])
def test_48_values_from_python_are_checked_too(value):
    with pytest.raises(ValueError, match=r"cell is .*; give a number from"):
        replace(COARSE, cell=value)
