"""The whole flow on a simulated pair, against the simulation's truth."""

from __future__ import annotations

import json
from dataclasses import replace
from datetime import date
from pathlib import Path
from types import SimpleNamespace

import geopandas
import laspy
import numpy as np
import pytest
import rasterio
from affine import Affine
from rasterio.features import geometry_mask
from shapely import Point
from slopewatch.engine.core.errors import InputError
from slopewatch.engine.core.progress import Progress
from slopewatch.engine.epochs.epoch import Epoch
from slopewatch.engine.geometry.rigid_transform import RigidTransform
from slopewatch.engine.grid.grid import Grid
from slopewatch.engine.grid.partition import Partition
from slopewatch.engine.objects.table import FIELDS as OBJECT_FIELDS
from slopewatch.engine.pointcloud.reading import read_cloud
from slopewatch.engine.zones.confirmation import VERDICTS, verdict, weigh
from slopewatch.interface.parameters import (
    ChangeParameters,
    DisplacementStepParameters,
    LastEpochParameters,
    SurveyParameters,
)
from slopewatch.simulation.surveys.survey import simulate_pair
from slopewatch.simulation.surveys.write import write_pair
from slopewatch.tests.builders.screening_clouds import screen_cloud
from slopewatch.workflows import last_epoch
from slopewatch.workflows.inspect import inspect_slope
from slopewatch.workflows.last_epoch import SCREENING_OUTPUTS
from slopewatch.workflows.products.change import CHANGE_OUTPUTS
from slopewatch.workflows.settings import Settings

RESIDUAL = LastEpochParameters(screening_method="residual", residual_threshold=0.05)


@pytest.fixture(scope="module")
def survey(tmp_path_factory):
    pair = simulate_pair(SurveyParameters(points=250_000, length=30.0, height=12.0, amplitude=0.4, seed=3))
    return pair, write_pair(pair, tmp_path_factory.mktemp("survey"))


def epochs(paths) -> tuple[Epoch, Epoch]:
    return Epoch(paths["first"], date(2024, 5, 1)), Epoch(paths["second"], date(2025, 5, 1))


@pytest.fixture(scope="module")
def run(survey, tmp_path_factory):
    _, paths = survey
    out = tmp_path_factory.mktemp("out") / "new"
    progress = Progress()
    off = DisplacementStepParameters(displacement=False)
    settings = Settings(change=ChangeParameters(cell=0.2), screening=RESIDUAL, displacement_step=off)
    done = inspect_slope(epochs(paths), out, settings, roi=paths["roi"], progress=progress)
    outputs, metrics = done.outputs, done.figures
    return out, outputs, metrics


def test_every_promised_output_exists_and_nothing_else_lies_about(run):
    out, outputs, _ = run
    for name in (*CHANGE_OUTPUTS, *SCREENING_OUTPUTS, "transform.json", "run.json"):
        assert (out / name).stat().st_size > 0, name
    assert all(path.exists() for path in outputs.values())
    assert not [p for p in out.rglob("*") if ".part" in p.name or p.name.startswith(".")]


def test_objects_are_compared_above_the_ground_and_none_but_plants_changed(run):
    """The later survey of the simulated slope has other ground, and no other object."""
    out, outputs, metrics = run
    frame = geopandas.read_file(out / "objects.gpkg", layer="objects")
    assert [name for name in frame.columns if name != "geometry"] == list(OBJECT_FIELDS)
    assert outputs["objects"] == out / "objects.gpkg"
    assert not set(frame["kind"]) - {"vegetation", "unknown"}
    assert metrics["objects_appeared"] == metrics["objects_vanished"] == 0
    assert 'id="objects"' in (out / "report.html").read_text(encoding="utf-8")


def test_motion_along_the_surface_that_is_switched_off_leaves_no_trace(run):
    out, outputs, metrics = run
    record = json.loads((out / "run.json").read_text())
    assert not {"displacement", "displacement_left_out"} & set(record)
    assert not {"displacement", "displacement_vectors", "smallest_motion"} & set(outputs)
    assert not [path for path in out.iterdir() if path.name.startswith(("displacement", "smallest_motion"))]
    assert not [name for name in metrics if "moving_zone" in name]
    assert 'id="motion"' not in (out / "report.html").read_text(encoding="utf-8")


def test_change_agrees_with_the_truth(survey, run):
    pair, _ = survey
    out, _, metrics = run
    with rasterio.open(out / "elevation_change.tif") as raster:
        dz = raster.read(1, masked=True).filled(np.nan)
        grid = Grid(raster.transform.c, raster.transform.f, raster.transform.a, *dz.shape)
        assert raster.crs.to_epsg() == 32651
        assert raster.tags()["EPOCH_FROM"] == "2024-05-01"
    truth = pair.true_change_raster(grid)
    error = (dz - truth)[np.isfinite(dz)]
    assert abs(np.median(error)) < 0.01
    assert 1.4826 * np.median(np.abs(error - np.median(error))) < 0.06
    assert 0.8 < metrics["common_cell_rate"] <= 1.0


def test_the_map_of_the_change_is_pale_within_each_cells_level(run):
    """The second band is opaque exactly where the significant change has data; the first one stays the change."""
    out, _, _ = run
    with rasterio.open(out / "elevation_change.tif") as change, rasterio.open(out / "significant_change.tif") as beyond:
        assert change.descriptions[0].startswith("Elevation change")
        assert (change.count, change.units) == (2, ("m", "1"))
        dz, opacity = change.read(masked=True)
        significant = beyond.read(1, masked=True)
    assert (opacity.mask == dz.mask).all()
    assert 0 < significant.count() < dz.count()
    np.testing.assert_array_equal(opacity.filled(0) == 255, ~significant.mask)
    assert (out / "screened.qml").read_text().count("<category ") == 3


def test_zones_lie_where_the_ground_changed(survey, run):
    pair, _ = survey
    out, _, metrics = run
    zones = geopandas.read_file(out / "zones.gpkg", layer="zones")
    assert len(zones) == metrics["zone_count"]
    assert {"uplift", "subsidence"} <= set(zones["kind"])
    inside = zones.to_crs(32651)
    grid = Grid(*_grid(out))
    truth = pair.true_change_raster(grid)
    row, column = np.nonzero(np.abs(truth) > 0.2)
    points = geopandas.GeoSeries.from_xy(
        grid.west + (column + 0.5) * grid.cell, grid.north - (row + 0.5) * grid.cell, crs=32651
    )
    assert points.within(inside.union_all()).mean() > 0.8
    # what is drawn is where something moved: little area lies far from any true change
    moved = points.buffer(2.0).union_all()
    assert inside[~inside.intersects(moved)].area.sum() < 0.05 * inside.area.sum()


def _grid(out):
    with rasterio.open(out / "elevation_change.tif") as raster:
        return raster.transform.c, raster.transform.f, raster.transform.a, raster.height, raster.width


def test_the_known_offset_is_undone(survey, run):
    pair, _ = survey
    out, _, _ = run
    found = RigidTransform.load(out / "transform.json")
    points = pair.second.xyz[::50]
    error = found.apply(points) - pair.transform.apply(points)
    slope = points - points.mean(axis=0)
    normal = np.linalg.svd(slope, full_matrices=False)[2][2]
    # across the face it is seen well; along it only by its unevenness
    assert np.abs(error @ normal).max() < 0.005
    assert np.sqrt(np.mean(np.sum(error**2, axis=1))) < 0.03


def test_run_record_tells_what_ran(run):
    out, _, metrics = run
    record = json.loads((out / "run.json").read_text())
    assert [s["stage"] for s in record["stages"]] == [
        "ground", "registration", "shared_ground", "change", "screening", "products", "objects", "report",
    ]  # fmt: skip
    assert all(s["seconds"] >= 0 and s["peak_memory_mb"] > 0 for s in record["stages"])
    assert record["pdal"]["version"]
    assert record["metrics"].keys() == metrics.keys()
    assert record["parameters"]["change"]["cell"] == 0.2
    assert record["transform"] == json.loads((out / "transform.json").read_text())["matrix"]
    assert {"elevation_change", "zones", "report"} <= set(record["outputs"])
    assert all((out / name).is_file() for name in record["outputs"].values())
    assert ".slopewatch-part" not in json.dumps(record)
    for ground in record["stages"][0]["epochs"].values():
        assert (out / ground["ground"]).is_file()


def test_the_last_epochs_ground_is_screened_as_the_screening_alone_does(run):
    out, outputs, metrics = run
    aligned = read_cloud(outputs["aligned"])
    screening, hazards = screen_cloud(aligned, RESIDUAL)
    labels, probability = screening.at(aligned.xyz)
    labelled = laspy.read(outputs["screened"])
    np.testing.assert_array_equal(labelled["slopewatch_class"], labels)
    np.testing.assert_array_equal(labelled["slopewatch_prob"], probability)
    np.testing.assert_allclose(labelled.xyz, aligned.xyz, atol=1e-6)
    zones = geopandas.read_file(out / "screened_zones.gpkg", layer="zones")
    assert len(zones) == metrics["screened_zone_count"] > 2
    assert zones.geometry.geom_equals(hazards.frame.geometry).all()
    assert (zones["probability"] == hazards.frame["probability"]).all()
    assert set(zones["run_id"]) == {json.loads((out / "run.json").read_text())["run_id"]}
    with rasterio.open(out / "screened_probability.tif") as raster:
        assert (raster.count, raster.tags()["EPOCH_TO"]) == (3, "2025-05-01")
        np.testing.assert_array_equal(raster.read(2, masked=True).filled(np.nan), hazards.probability[1])


def test_the_word_about_a_screened_zone_agrees_with_the_truth(survey, run):
    pair, _ = survey
    out, _, metrics = run
    zones = geopandas.read_file(out / "screened_zones.gpkg", layer="zones")
    fine = Grid(*_grid(out))
    truth = pair.true_change_raster(fine)
    words = []
    for kind, word, geometry in zip(zones["kind"], zones["confirmed"], zones.geometry, strict=True):
        inside = geometry_mask([geometry], fine.shape, Affine(*fine.affine), invert=True)
        moved = np.nanmean(truth[inside]) * (1 if kind == "uplift" else -1)
        if abs(moved) < 0.005:
            assert word in ("not confirmed", "not measured")
        if moved > 0.15:
            assert word == "confirmed"
        words.append(word)
    assert {"confirmed", "not confirmed"} <= set(words)
    for word in VERDICTS:
        assert metrics[f"{word.replace(' ', '_')}_zones"] == words.count(word)


def test_the_words_hold_for_discs_on_ground_whose_change_is_known(survey, run):
    """What docs/guide.md says of the limits, on the change of this run."""
    pair, _ = survey
    out, _, _ = run
    bands = []
    for name in ("elevation_change.tif", "significant_change.tif", "cell_size.tif"):
        with rasterio.open(out / name) as raster:
            bands.append(raster.read(1, masked=True).filled(np.nan))
    dz, significant = bands[0], np.isfinite(bands[1])
    grid = Grid(*_grid(out))
    # cells of one size with one change in one square are one grown cell
    row, column = np.indices(dz.shape)
    size = np.round(np.nan_to_num(bands[2].astype(np.float64), nan=grid.cell), 3)
    square = [
        np.floor(place / size + 1e-6) for place in (grid.west + column * grid.cell, grid.north - (row + 1) * grid.cell)
    ]
    cells = np.stack([size, *square, np.nan_to_num(dz)]).reshape(4, -1)
    block = np.unique(cells, axis=1, return_inverse=True)[1].reshape(dz.shape)
    block[np.isnan(dz)] = -1
    change = SimpleNamespace(grid=grid, dz=dz, significant=significant, partition=Partition.of_blocks(block, grid.cell))
    truth = np.where(np.isfinite(dz), pair.true_change_raster(grid), np.nan)
    rng = np.random.default_rng(0)
    cells = np.argwhere(np.isfinite(dz))
    words: dict[str, list[str]] = {"still": [], "moved": []}
    for row, column in rng.permutation(cells)[:1500]:
        middle = Point(grid.west + (column + 0.5) * grid.cell, grid.north - (row + 0.5) * grid.cell)
        disc = middle.buffer(rng.choice([0.4, 0.8, 1.5]))
        inside = geometry_mask([disc], grid.shape, Affine(*grid.affine), invert=True)
        moved = np.nanmean(truth[inside])
        word = verdict(weigh(disc, 1.0 if moved >= 0 else -1.0, change, outline_cell=0.25))
        # a grown cell at the rim of a change shows its mean on still ground as well
        reached = np.isin(block, block[inside & (block >= 0)])
        if abs(moved) < 0.005 < np.max(np.abs(truth[reached]), initial=0.0):
            continue
        if word != "not measured" and not 0.005 <= abs(moved) <= 0.1:
            words["moved" if abs(moved) > 0.1 else "still"].append(word)
    assert len(words["still"]) > 1000
    assert len(words["moved"]) > 50
    # discs overlap, so that one place of noise makes several words
    assert sum(word != "not confirmed" for word in words["still"]) <= 0.01 * len(words["still"])
    assert set(words["moved"]) == {"confirmed"}


def test_one_epoch_is_screened_and_nothing_else(survey, tmp_path):
    _, paths = survey
    epoch, out, progress = epochs(paths)[1], tmp_path / "out", Progress()
    out.mkdir()
    for name in ("zones.gpkg", "report.html"):
        (out / name).touch()
    given = {"roi": paths["roi"], "progress": progress}
    with pytest.raises(InputError, match=r"holds results already \(zones\.gpkg\)"):
        inspect_slope([epoch], out, Settings(screening=RESIDUAL), **given)
    done = inspect_slope([epoch], out, Settings(screening=RESIDUAL), overwrite=True, **given)
    outputs, metrics = done.outputs, done.figures
    assert {p.name for p in out.iterdir()} == {
        *SCREENING_OUTPUTS, "screened.qml", "screened_probability.qml", "screened_smallest_hazard.qml", "run.json",
        "report.html",
        "clouds", "zones.gpkg",
    }  # fmt: skip
    assert [w for w in progress.warnings if w.endswith("outputs of an earlier run: zones.gpkg.")]
    assert set(outputs) == {
        "screened", "screened_zones", "screened_probability", "screened_smallest_hazard", "screened_map",
        "epoch_ground", "report", "run",
    }  # fmt: skip
    assert all(path.is_file() for path in outputs.values())
    sentence = json.loads(outputs["run"].read_text())["detectable"]
    needed = metrics["screened_smallest_hazard_m"]["3"]["median"]
    assert f"a hazard 3 m wide must stand {needed:.2f} m out" in sentence
    assert sentence in outputs["report"].read_text(encoding="utf-8")
    zones = geopandas.read_file(outputs["screened_zones"], layer="zones")
    assert len(zones) == metrics["screened_zone_count"] > 0
    assert "confirmed" not in zones
    assert "confirmed_zones" not in metrics
    record = json.loads(outputs["run"].read_text())
    assert [s["stage"] for s in record["stages"]] == ["ground", "screening", "products", "report"]
    assert metrics["screened_ground_points"] == len(laspy.read(outputs["epoch_ground"]).points)


def test_a_slope_that_cannot_be_screened_gets_all_else(survey, tmp_path):
    _, paths = survey
    progress = Progress()
    wall = replace(RESIDUAL, minimum_dip=85.0)
    settings = Settings(change=ChangeParameters(cell=0.2), screening=wall)
    out = tmp_path / "out"
    done = inspect_slope(epochs(paths), out, settings, roi=paths["roi"], progress=progress)
    outputs, metrics = done.outputs, done.figures
    assert all((out / name).is_file() for name in CHANGE_OUTPUTS)
    assert not list(out.glob("screened*"))
    assert metrics["zone_count"] > 0
    assert not [name for name in (*outputs, *metrics) if name.startswith("screened") or "confirmed" in name]
    left_out = [w for w in progress.warnings if w.startswith("The last survey was not screened. ")]
    assert len(left_out) == 1
    assert paths["second"].name in left_out[0]
    assert "minimum_dip" in left_out[0]
    record = json.loads((out / "run.json").read_text())
    assert left_out[0] in record["warnings"]
    assert left_out[0].endswith(record["screening_left_out"])
    # alone, it is all there is to be done
    with pytest.raises(InputError, match="minimum_dip"):
        inspect_slope(epochs(paths)[1:], tmp_path / "one", settings, roi=paths["roi"])
    assert not (tmp_path / "one").exists()


def test_what_this_machine_lacks_is_known_before_any_work(survey, tmp_path, monkeypatch):
    def missing(*_):
        raise InputError("No torch here.")

    monkeypatch.setattr("slopewatch.models.screening.method.ReliefModel", missing)
    assert last_epoch.obstacle(LastEpochParameters()) == "No torch here."
    assert last_epoch.obstacle(RESIDUAL) is None
    with pytest.raises(InputError, match="No torch"):
        last_epoch.obstacle(LastEpochParameters(device="gpu"))
    with pytest.raises(InputError, match="do not exist"):
        last_epoch.obstacle(LastEpochParameters(weights="mine.safetensors"))
    monkeypatch.setattr("slopewatch.models.screening.method.kind_of", lambda _: "relief U-Net")
    (tmp_path / "mine.safetensors").touch()
    with pytest.raises(InputError, match="No torch"):
        last_epoch.obstacle(LastEpochParameters(weights=str(tmp_path / "mine.safetensors")))
    with pytest.raises(InputError, match="No torch"):
        inspect_slope(epochs(survey[1])[:1], tmp_path / "one", Settings())
    off = LastEpochParameters(screen_last_epoch=False)
    with pytest.raises(InputError, match="two epochs"):
        inspect_slope(epochs(survey[1])[:1], tmp_path / "one", Settings(screening=off))
    assert not (tmp_path / "one").exists()


def test_kept_pipelines_name_files_that_exist(run):
    out, _, _ = run
    pipelines = sorted(out.rglob("*.json"))
    kept = [p for p in pipelines if p.name not in ("run.json", "transform.json")]
    assert len(kept) >= 4
    for path in kept:
        text = path.read_text()
        assert ".slopewatch-part" not in text
        reader = json.loads(text)
        stages = reader["pipeline"] if isinstance(reader, dict) else reader
        source = next(s["filename"] if isinstance(s, dict) else s for s in stages)
        assert (out / source).exists() or Path(source).exists(), source


def test_an_epoch_that_fails_leaves_nothing(survey, tmp_path):
    _, paths = survey
    broken = tmp_path / "2025-05-01.laz"
    broken.write_bytes(paths["second"].read_bytes()[:200_000])
    out = tmp_path / "out"
    with pytest.raises(InputError, match=r"2025-05-01\.laz"):
        inspect_slope((epochs(paths)[0], Epoch(broken, date(2025, 5, 1))), out, Settings(), roi=paths["roi"])
    assert not out.exists()
