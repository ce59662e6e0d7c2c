"""The command displacement from files to files: what it writes, and what it says of what it cannot see."""

from __future__ import annotations

import json
import re
from pathlib import Path

import geopandas as gpd
import laspy
import numpy as np
import pyogrio
import pytest
import rasterio
import shapely
from pyproj import CRS
from slopewatch.engine.core.errors import InputError
from slopewatch.engine.core.progress import Progress
from slopewatch.engine.core.run_result import RunResult
from slopewatch.engine.displacement.status import Status
from slopewatch.engine.displacement.vectors import threshold
from slopewatch.engine.geometry.rigid_transform import RigidTransform
from slopewatch.engine.maps import displacement_styles, opacity_band
from slopewatch.engine.pointcloud import in_parts
from slopewatch.interface.parameters import (
    DisplacementParameters,
    MotionMemoryParameters,
    ReportParameters,
    SurfaceParameters,
)
from slopewatch.tests.builders.rough_ground import axes, relief, sampled
from slopewatch.workflows import pair as workflow_pair
from slopewatch.workflows.displacement import displacement_step
from slopewatch.workflows.products.displacement import directions
from slopewatch.workflows.report import report_step
from slopewatch.workflows.settings import DisplacementSettings

MOTION = np.array([0.15, 0.0, 0.0]) @ axes()


def written(path: Path, xyz: np.ndarray) -> Path:
    las = laspy.LasData(laspy.LasHeader(point_format=6, version="1.4"))
    las.header.scales, las.header.offsets = [0.001] * 3, np.floor(xyz.min(axis=0))
    las.header.add_crs(CRS.from_epsg(32651))
    las.xyz = xyz
    las.return_number[:], las.number_of_returns[:] = 1, 1
    las.write(path)
    return path


@pytest.fixture(scope="module")
def pair(tmp_path_factory) -> tuple[Path, Path]:
    folder = tmp_path_factory.mktemp("pair")
    heights = relief(15.0, 0.15, seed=7)
    first, later = (sampled(heights, 60.0, 0.02, seed) for seed in (1, 2))
    return written(folder / "2024-05-01.laz", first), written(folder / "2025-05-01.laz", later + MOTION)


def run(pair: tuple[Path, Path], folder: Path, progress: Progress | None = None, **more) -> RunResult:
    settings = DisplacementSettings(
        surface=SurfaceParameters(ground="as_is"),
        displacement=more.pop("displacement", DisplacementParameters()),
        motion_memory=more.pop("motion_memory", MotionMemoryParameters()),
    )
    given = {"dates": (None, None), "transform_path": None, "progress": progress or Progress()} | more
    return displacement_step(*pair, folder, settings, **given)


@pytest.fixture(scope="module")
def outcome(pair, tmp_path_factory) -> tuple[RunResult, Progress]:
    progress = Progress()
    return run(pair, tmp_path_factory.mktemp("out") / "motion", progress), progress


def test_the_raster_holds_the_motion_and_its_errors(outcome):
    with rasterio.open(outcome[0].outputs["displacement"]) as raster:
        bands = dict(zip(raster.descriptions, raster.read(masked=True), strict=True))
        assert raster.crs.to_epsg() == 32651
        assert raster.tags()["EPOCH_FROM"] == "2024-05-01"
    for name, true in zip(("east", "north", "up"), MOTION, strict=True):
        assert np.ma.median(bands[f"motion {name}"]) == pytest.approx(true, abs=0.02)
    assert np.ma.median(bands["motion down the dip"]) == pytest.approx(0.15, abs=0.02)
    assert 0.002 < np.ma.median(bands["standard error down the dip"]) < 0.05
    (status,) = (band for name, band in bands.items() if name.startswith("status"))
    assert ((status == Status.MEASURED) == ~bands["motion east"].mask).all()
    # by its last band QGIS shows pale what still ground shows as well
    shown = bands[displacement_styles.OPACITY_NAME]
    assert raster.count == displacement_styles.OPACITY_BAND
    assert (shown.mask == bands["motion east"].mask).all()
    # half of the rate of error for each of both widths
    beyond = bands["motion along the surface in standard errors"] ** 2 > threshold(0.995)
    assert np.ma.count(beyond) > 20
    assert (shown == np.where(beyond.filled(False), opacity_band.OPAQUE, opacity_band.WITHIN)).all()
    assert np.ma.sum(beyond) > 0


def test_vectors_and_zones_are_layers_with_their_styles(outcome):
    path = outcome[0].outputs["displacement_vectors"]
    vectors, zones = (gpd.read_file(path, layer=name) for name in ("vectors", "zones"))
    assert len(vectors) > 5
    assert vectors["azimuth_deg"].median() == pytest.approx(90.0, abs=8)
    assert vectors["plunge_deg"].median() == pytest.approx(35.0, abs=5)
    assert (vectors["err_major_m"] >= vectors["err_minor_m"]).all()
    assert (vectors["p_value"] <= 0.01).all()
    assert len(zones) == 1
    assert zones["length_m"][0] == pytest.approx(0.15, abs=4 * zones["length_err_m"][0])
    assert zones["off_dip_deg"][0] == pytest.approx(0.0, abs=4 * zones["off_dip_err_deg"][0])
    assert zones.geometry[0].area == pytest.approx(zones["area_m2"][0])
    styles = gpd.read_file(path, layer="layer_styles")
    assert set(styles["f_table_name"]) == {"vectors", "zones", "one_direction"}
    assert all("make_ellipse(" in qml and "&amp;quot;" not in qml for qml in styles["styleQML"])


def test_every_column_and_band_is_explained(outcome, root):
    page = (root / "docs" / "displacement.md").read_text(encoding="utf-8")
    path = outcome[0].outputs["displacement_vectors"]
    columns = {c for name in ("vectors", "zones", "one_direction") for c in gpd.read_file(path, layer=name).columns}
    axes_errors = {f"{axis}_err_m" for axis in ("along_dip", "across", "normal")}  # of a row with `..._err_m`
    assert sorted(c for c in columns - axes_errors - {"geometry"} if f"`{c}`" not in page) == []
    with rasterio.open(outcome[0].outputs["displacement"]) as raster:
        names = [name.partition(":")[0] for name in raster.descriptions]
    axes = ["east", "north", "up", "down the dip", "across the dip", "normal to the surface"]
    errors = [name.removeprefix("standard error ") for name in names[6:12]]
    assert errors == axes
    assert [name.removeprefix("motion ").partition(",")[0] for name in names[:6]] == axes
    last = [names[12].split()[-1], *(n.split()[0] for n in names[13:])]
    assert last == ["errors", "share", "width", "status", "Opacity"]
    assert "13 | length along the surface in standard errors" in page


def test_errors_of_directions_are_the_scatter_of_many_draws():
    rng = np.random.default_rng(3)
    motion, root = np.array([0.08, -0.11, -0.06]), rng.normal(0.0, 0.004, (3, 3))
    covariance = root @ root.T
    drawn = directions(motion + rng.multivariate_normal(np.zeros(3), covariance, 20_000), np.zeros((20_000, 3, 3)))
    stated = directions(motion[None], covariance[None])
    for name in ("azimuth", "plunge"):
        assert stated[f"{name}_err_deg"][0] == pytest.approx(drawn[f"{name}_deg"].std(), rel=0.04)
    assert stated["length_err_m"][0] == pytest.approx(drawn["length_m"].std(), rel=0.04)


def test_the_smallest_motion_is_three_errors(outcome):
    with rasterio.open(outcome[0].outputs["smallest_motion"]) as raster:
        smallest = raster.read(1, masked=True)
    record = json.loads(outcome[0].outputs["run"].read_text())
    assert np.ma.median(smallest) == pytest.approx(record["metrics"]["smallest_motion_median_m"], rel=0.2)


def test_an_unknown_error_of_the_registration_is_said(outcome):
    assert any("registration's error along the surface is not known" in w for w in outcome[1].warnings)


def test_the_transform_s_covariance_widens_the_errors(pair, outcome, tmp_path):
    facts = {"covariance": np.diag([0, 0, 0, 4e-4, 4e-4, 1e-6]).tolist(), "unobservable": ["shift along the road"]}
    RigidTransform.identity().save(tmp_path / "transform.json", CRS.from_epsg(32651), facts)
    progress = Progress()
    done = run(pair, tmp_path / "out", progress, transform_path=tmp_path / "transform.json")
    with rasterio.open(done.outputs["displacement"]) as wide, rasterio.open(outcome[0].outputs["displacement"]) as own:
        band = own.descriptions.index("standard error east") + 1
        more = wide.read(band, masked=True).astype(float) ** 2 - own.read(band, masked=True).astype(float) ** 2
    assert np.ma.median(more) == pytest.approx(4e-4, rel=0.05)
    assert any("does not fix the surveys' shift along the road" in w for w in progress.warnings)


def test_stable_ground_takes_its_motion_off(pair, tmp_path):
    stable = tmp_path / "stable.gpkg"
    area = shapely.box(499_990, 2_999_990, 500_020, 3_000_020)
    gpd.GeoDataFrame(geometry=[area], crs="EPSG:32651").to_file(stable)
    done = run(pair, tmp_path / "out", stable=stable)
    assert done.figures["taken_off_m"] == pytest.approx(MOTION, abs=0.02)
    assert done.figures["moving_zone_count"] == 0


def test_a_smooth_face_says_why_it_shows_nothing(tmp_path):
    flat = np.zeros((240, 240))
    pair = [written(tmp_path / f"202{k}-01-01.laz", sampled(flat, 60.0, 0.02, k)) for k in (4, 5)]
    progress = Progress()
    done = run((pair[0], pair[1]), tmp_path / "out", progress)
    assert done.figures["significant_vectors"] == 0
    assert any("no motion along the surface can be given: no relief" in w for w in progress.warnings)
    zones = pyogrio.read_info(done.outputs["displacement_vectors"], layer="zones")
    kinds = dict(zip(zones["fields"], zones["ogr_types"], strict=True))
    assert (zones["features"], kinds["zone_id"], kinds["area_m2"]) == (0, "OFTString", "OFTReal")


def test_what_moved_beyond_the_search_is_said_with_the_search(pair, tmp_path):
    far = written(tmp_path / "2026-05-01.laz", laspy.read(pair[0]).xyz + 10 * MOTION)
    progress = Progress()
    done = run((pair[0], far), tmp_path / "out", progress)
    assert done.figures["significant_vectors"] == 0
    assert any("moved farther than the 1 m up to which motion is looked for" in w for w in progress.warnings)


@pytest.mark.parametrize(
    ("shift", "said"),
    [
        ((500.0, 0.0, 0.0), r"^The epochs do not overlap: the first spans x \d.*, the second x \d.* reference system"),
        ((0.0, 0.0, 32.0), r"lies about 32\.0 m above .* over the whole overlap: ellipsoidal against orthometric"),
    ],
    ids=["elsewhere", "other heights"],
)
def test_surveys_that_cannot_be_laid_on_each_other_are_refused_with_the_figure(shift, said, pair, tmp_path):
    other = written(tmp_path / "2026-05-01.laz", laspy.read(pair[1]).xyz + np.array(shift))
    with pytest.raises(InputError, match=said):
        run((pair[0], other), tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_a_folder_with_results_is_not_written_into(pair, outcome):
    with pytest.raises(InputError, match="overwrite"):
        run(pair, outcome[0].outputs["run"].parent)


def test_surveys_on_the_disk_give_the_same_files(pair, outcome, tmp_path, monkeypatch):
    monkeypatch.setattr(workflow_pair, "MAX_HELD_POINTS", 0)
    monkeypatch.setattr(in_parts, "_PART_POINTS", 3000)
    progress = Progress()
    done = run(pair, tmp_path / "motion", progress, motion_memory=MotionMemoryParameters(memory_limit=1.2))
    held, folder = outcome[0].outputs["run"].parent, tmp_path / "motion"
    names = {path.name for path in held.iterdir()}
    assert names == {path.name for path in folder.iterdir()}
    for name in names - {"run.json", "report.html"}:  # these tell when they were made
        assert (folder / name).read_bytes() == (held / name).read_bytes(), name
    assert done.figures == outcome[0].figures
    record = json.loads((folder / "run.json").read_text())
    assert record["parameters"]["motion_memory"] == {"memory_limit": 1.2}
    assert next(stage for stage in record["stages"] if stage["stage"] == "read")["in_parts"]


def test_a_memory_that_holds_not_even_parts_is_refused_by_the_headers(pair, tmp_path):
    points = sum(laspy.open(cloud).header.point_count for cloud in pair)
    with pytest.raises(InputError, match=rf"The {points:,} points of .*2024-05-01\.laz.* need at least 0\.67 GB"):
        run(pair, tmp_path / "motion", motion_memory=MotionMemoryParameters(memory_limit=0.3))
    assert not (tmp_path / "motion").exists()


def test_the_report_has_the_zone_of_the_record_and_the_words_for_what_is_not_seen(outcome):
    folder = outcome[0].outputs["run"].parent
    record = json.loads((folder / "run.json").read_text())
    facts = record["displacement"]
    (zone,) = facts["zones"]
    layer = gpd.read_file(folder / "displacement.gpkg", layer="zones")
    for name in (
        "length_m",
        "length_err_m",
        "azimuth_deg",
        "plunge_deg",
        "along_dip_m",
        "across_m",
        "p_map",
        "area_m2",
    ):
        assert zone[name] == pytest.approx(layer[name][0], rel=1e-6, abs=1e-9), name
    assert zone["direction"] == "down the slope"
    assert zone["dip_deg"] == pytest.approx(35.0, abs=3)
    assert 0 < zone["off_dip_err_deg"] < 10
    assert layer.geometry[0].buffer(0.01).contains(shapely.Point(zone["x"], zone["y"]))
    text = outcome[0].outputs["report"].read_text(encoding="utf-8")
    assert text.count('<h2 id="motion">') == 1
    assert "zone slides along the surface" in text.replace("</data> ", "")
    assert "The error of the registration along the surface is not known" in text
    assert "no motion above the level of detection was seen" in text.lower()


def test_the_report_is_made_again_from_the_folder(outcome):
    path = outcome[0].outputs["report"]
    before = path.read_bytes()
    again = report_step(path.parent, ReportParameters(), profiles=None, progress=Progress())
    assert again.outputs["report"].read_bytes() == before


def test_where_nothing_is_seen_the_report_does_not_say_that_nothing_moved(tmp_path):
    flat = np.zeros((200, 200))
    pair = [written(tmp_path / f"202{k}-01-01.laz", sampled(flat, 60.0, 0.02, k)) for k in (4, 5)]
    done = run((pair[0], pair[1]), tmp_path / "out")
    record = json.loads(done.outputs["run"].read_text())["displacement"]
    assert sum(row["share"] for row in record["refused"]) == pytest.approx(1 - record["measured_share"])
    assert record["refused"][0]["reason"].startswith("no relief")
    text = done.outputs["report"].read_text(encoding="utf-8")
    section = text[text.index('<h2 id="motion">') : text.index("</section>")]
    words = re.sub(r"\s+", " ", re.sub("<[^>]+>", "", section))
    assert "Nowhere on this ground a motion along the surface, or its absence, can be seen." in words
    assert "nothing is known of" in words
    assert not re.search(r"[Nn]o motion(?! above)", words)


@pytest.mark.parametrize(("points_per_m2", "said"), [(12.0, True), (30.0, False)])
def test_ground_too_sparse_for_its_errors_is_said(tmp_path, points_per_m2, said):
    heights = relief(12.0, 0.15, seed=7)
    days = ("2024-05-01.laz", "2025-05-01.laz")
    pair = [written(tmp_path / day, sampled(heights, points_per_m2, 0.02, seed)) for seed, day in enumerate(days)]
    progress = Progress()
    done = run((pair[0], pair[1]), tmp_path / "out", progress)
    sentences = [w for w in progress.warnings if "ground points a m²; with less than 20" in w]
    assert bool(sentences) == said
    record = json.loads(done.outputs["run"].read_text())
    assert record["displacement"]["notes"][: len(sentences)] == sentences


def test_vectors_that_chance_makes_are_in_no_layer_and_pale(tmp_path):
    heights = relief(15.0, 0.15, seed=7)
    still = [written(tmp_path / f"202{k}-05-01.laz", sampled(heights, 60.0, 0.02, k)) for k in (4, 5)]
    done = run((still[0], still[1]), tmp_path / "out", displacement=DisplacementParameters(vector_confidence=0.8))
    assert 0 < done.figures["significant_vectors"] <= done.figures["chance_vectors_most"]
    assert not len(gpd.read_file(done.outputs["displacement_vectors"], layer="vectors"))
    with rasterio.open(done.outputs["displacement"]) as raster:
        shown = raster.read(displacement_styles.OPACITY_BAND, masked=True)
    assert set(np.unique(shown.compressed())) == {opacity_band.WITHIN}
