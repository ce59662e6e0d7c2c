"""Corrections by hand in whole runs: a heap that is excluded, a car that is no ground."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from datetime import date

import geopandas
import laspy
import numpy as np
import pytest
import rasterio
from rasterio.features import geometry_mask
from shapely import Point, box
from slopewatch.engine.core.errors import InputError
from slopewatch.engine.core.progress import Progress
from slopewatch.engine.epochs.epoch import Epoch
from slopewatch.interface.parameters import (
    ChangeParameters,
    DisplacementStepParameters,
    LastEpochParameters,
    RawGroundParameters,
    SurveyParameters,
)
from slopewatch.interface.seen import EXCLUDED, OUTSIDE
from slopewatch.simulation.surveys.survey import simulate_pair
from slopewatch.simulation.surveys.write import write_pair
from slopewatch.workflows.batch.kept_ground import keep_ground
from slopewatch.workflows.inspect import inspect_slope
from slopewatch.workflows.layer_files import LayerFiles
from slopewatch.workflows.series import monitor_series
from slopewatch.workflows.settings import SeriesSettings, Settings

SETTINGS = Settings(
    ground=RawGroundParameters(ground="class_2"),
    change=ChangeParameters(cell=0.25),
    displacement_step=DisplacementStepParameters(displacement=False),
    screening=LastEpochParameters(screen_last_epoch=False),
)


@pytest.fixture(scope="module")
def survey(tmp_path_factory):
    """A pair whose true ground has class 2, as have a heap and a car of the later survey; outlines of these two."""
    parameters = SurveyParameters(points=60_000, length=24.0, height=10.0, amplitude=0.4, seed=3)
    pair = simulate_pair(parameters)
    paths = write_pair(pair, tmp_path_factory.mktemp("survey"))
    heap, car = Point(500_515.5, 3_500_261.5), box(500_522.0, 3_500_265.5, 500_526.0, 3_500_267.5)
    for name in ("first", "second"):
        las = laspy.read(paths[name])
        las.classification = np.where(np.asarray(las.truth_ground) == 1, 2, 1).astype(np.uint8)
        x, y = np.asarray(las.x), np.asarray(las.y)
        if name == "second":
            away = np.hypot(x - heap.x, y - heap.y)
            on_car = (abs(x - 500_524.0) < 1.9) & (abs(y - 3_500_266.5) < 0.9)
            las.z = np.asarray(las.z) + np.where(away < 1.5, 1.0 - away / 1.5, 0.0) + np.where(on_car, 1.5, 0.0)
        las.write(paths[name])
    return paths, heap.buffer(2.0), car


def epochs(paths) -> tuple[Epoch, Epoch]:
    return Epoch(paths["first"], date(2024, 5, 1)), Epoch(paths["second"], date(2025, 5, 1))


def corrections(path, rows, shapes):
    geopandas.GeoDataFrame(rows, geometry=shapes, crs=32651).to_file(path)
    return LayerFiles(corrections=path)


@pytest.fixture(scope="module")
def runs(survey, tmp_path_factory):
    """The folder of a run that was made again with corrections, which lie beside its results; both runs' zones."""
    paths, heap, car = survey
    out = tmp_path_factory.mktemp("out") / "run"
    before = inspect_slope(epochs(paths), out, SETTINGS, roi=paths["roi"])
    zones = [geopandas.read_file(out / "zones.gpkg", layer="zones").to_crs(32651)]
    rows = {
        "action": ["exclude", "not_ground"],
        "reason": ["heap of the works", "parked car"],
        "epoch": ["", "2025-05-01"],
    }
    layers = corrections(out / "corrections.gpkg", rows, [heap, car])
    kept = (out / "corrections.gpkg").read_bytes()
    after = inspect_slope(epochs(paths), out, SETTINGS, roi=paths["roi"], layers=layers, overwrite=True)
    zones.append(geopandas.read_file(out / "zones.gpkg", layer="zones").to_crs(32651))
    assert (out / "corrections.gpkg").read_bytes() == kept
    return out, zones, before.figures, after.figures


def test_the_zones_of_the_heap_and_of_the_car_vanish_and_no_other(survey, runs):
    _, heap, car = survey
    _, (before, after), figures, corrected = runs
    on_either = before.geometry.intersects(heap) | before.geometry.intersects(car)
    assert on_either.sum() == 2
    assert not (after.geometry.intersects(heap.buffer(-0.3)) | after.geometry.intersects(car.buffer(-0.3))).any()
    assert len(after) == len(before) - 2
    # cone of 1 m on 1.5 m, and a car of 3.8 by 1.8 by 1.5 m
    added = np.pi * 1.5**2 / 3 + 3.8 * 1.8 * 1.5
    assert figures["vol_gain_m3"] - corrected["vol_gain_m3"] == pytest.approx(added, rel=0.12)


def test_what_is_excluded_has_no_change_and_is_named_as_excluded(survey, runs):
    _, heap, _ = survey
    out, _, _, _ = runs
    with rasterio.open(out / "elevation_change.tif") as raster:
        dz = raster.read(1, masked=True)
        inside = geometry_mask([heap], raster.shape, raster.transform, invert=True)
        around = geometry_mask([heap.buffer(1.0)], raster.shape, raster.transform, invert=True)
    with rasterio.open(out / "seen.tif") as raster:
        classes = raster.read(1)
    assert inside.any()
    assert dz.mask[inside].all()
    assert (classes[inside] == EXCLUDED).all()
    assert not (classes[~around] == EXCLUDED).any()
    record = json.loads((out / "run.json").read_text())
    share = np.count_nonzero(classes == EXCLUDED) / np.count_nonzero(classes != OUTSIDE)
    assert record["seen"]["excluded"] == pytest.approx(share)


def test_the_heap_that_is_excluded_is_no_object(survey, runs):
    _, heap, _ = survey
    objects = geopandas.read_file(runs[0] / "objects.gpkg", layer="objects").to_crs(32651)
    assert not objects.geometry.representative_point().within(heap).any()
    record = json.loads((runs[0] / "run.json").read_text())
    counted = ("objects_appeared", "objects_vanished", "objects_unknown", "objects_vegetation")
    assert sum(record["metrics"][name] for name in counted) == len(objects)


def test_record_and_report_name_each_correction(survey, runs):
    _, heap, car = survey
    out, _, _, _ = runs
    record = json.loads((out / "run.json").read_text())
    facts = record["corrections"]
    assert facts["exclude_area_m2"] == pytest.approx(heap.area)
    assert facts["not_ground_area_m2"] == pytest.approx(car.area)
    assert [(row["action"], row["reason"], row["epoch"]) for row in facts["areas"]] == [
        ("exclude", "heap of the works", ""),
        ("not_ground", "parked car", "2025-05-01"),
    ]
    [given] = [i for i in record["inputs"] if i["role"] == "corrections"]
    assert len(given["sha256"]) == 64
    page = re.sub(r"\s+", " ", (out / "report.html").read_text())
    assert "heap of the works" in page
    assert "parked car" in page


def test_ground_that_was_corrected_is_not_taken_for_what_an_extraction_found(runs, tmp_path):
    out, _, _, _ = runs
    assert keep_ground(out, tmp_path / "series") == 0


def test_a_series_uses_them_and_refuses_forced_ground_in_ground_clouds(survey, tmp_path):
    paths, heap, car = survey
    settings = SeriesSettings(
        ground=SETTINGS.ground,
        change=ChangeParameters(cell=0.5),
        displacement_step=SETTINGS.displacement_step,
    )
    layers = corrections(tmp_path / "c.gpkg", {"action": ["exclude", "not_ground"]}, [heap, car])
    monitor_series(epochs(paths), tmp_path / "out", settings, roi=paths["roi"], layers=layers)
    zones = geopandas.read_file(tmp_path / "out" / "series.gpkg", layer="zones").to_crs(32651)
    assert len(zones)
    assert not (zones.geometry.intersects(heap.buffer(-0.5)) | zones.geometry.intersects(car.buffer(-0.5))).any()
    ready = replace(settings, ground=RawGroundParameters(ground="as_is"))
    forced = corrections(tmp_path / "f.gpkg", {"action": ["ground"]}, [heap])
    with pytest.raises(InputError, match="has areas with the action ground, but all points of the surveys are taken"):
        monitor_series(epochs(paths), tmp_path / "other", ready, roi=paths["roi"], layers=forced)


@pytest.mark.parametrize(
    ("rows", "move", "words"),
    [
        ({"action": ["exclude"]}, 5000.0, r"^No correction of .* lies on the slope; check the reference system"),
        ({"action": ["heap"]}, 0.0, "has the action 'heap'; give exclude, ground or not_ground"),
        ({"action": ["exclude"], "epoch": ["2023-01-01"]}, 0.0, "but the surveys are 2024-05-01, 2025-05-01; give"),
    ],
)
def test_what_cannot_be_used_is_refused_before_any_work(survey, tmp_path, rows, move, words):
    paths, heap, _ = survey
    moved = geopandas.GeoSeries([heap]).translate(move).to_list()
    layers = corrections(tmp_path / "c.gpkg", rows, moved)
    out = tmp_path / "out"
    with pytest.raises(InputError, match=words):
        inspect_slope(epochs(paths), out, SETTINGS, roi=paths["roi"], layers=layers, progress=Progress())
    assert not out.exists()
