"""A series whose ground creeps along its surface, through the whole flow, against the simulation's truth."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import geopandas
import numpy as np
import pandas as pd
import pytest
import rasterio
from geopandas.testing import assert_geodataframe_equal
from slopewatch.engine.core.progress import Progress
from slopewatch.engine.displacement.registered import Registered
from slopewatch.engine.series.motion.field import References, Surveys
from slopewatch.interface.parameters import DisplacementStepParameters, RegistrationParameters, SurveyParameters
from slopewatch.simulation.surveys.series import Creep, simulate_series, survey_days, write_series
from slopewatch.tests.builders.series_clouds import FIXED, READY, plane, surveys
from slopewatch.workflows import pair, series_motion
from slopewatch.workflows.products.series_motion import SERIES_MOTION_OUTPUTS
from slopewatch.workflows.series import monitor_series

RATE = 0.003  # m a day in the middle
KEPT = replace(READY, registration=RegistrationParameters(method="none"))
OFF = DisplacementStepParameters(displacement=False)


@pytest.fixture(scope="module")
def creeping(tmp_path_factory):
    parameters = SurveyParameters(
        seed=4, points=52_000, length=14.0, height=9.0, vegetation=0.1, offset=0.0, motion="creep"
    )
    series = simulate_series(parameters, survey_days(3, 60), (Creep(RATE),))
    return series, write_series(series, tmp_path_factory.mktemp("creeping"), ground_only=True)


@pytest.fixture(scope="module")
def runs(creeping, tmp_path_factory):
    """The first two surveys, all three into the same folder, and all three without motion."""
    _, paths = creeping
    out = tmp_path_factory.mktemp("out")
    found = [monitor_series(surveys(paths)[:count], out / "motion", KEPT, roi=paths["roi"]) for count in (2, 3)]
    heights = monitor_series(surveys(paths), out / "heights", replace(KEPT, displacement_step=OFF), roi=paths["roi"])
    return out, (*found, heights)


def layer(folder: Path, name: str, file: str = "displacement.gpkg") -> geopandas.GeoDataFrame:
    return geopandas.read_file(folder / file, layer=name)


def true_velocity(series, places: np.ndarray) -> np.ndarray:
    """Mean of the true velocities (mm/day) at places (n, 2)."""
    from slopewatch.engine.grid.grid import Grid
    from slopewatch.simulation.surveys.true_motion import motion_raster

    low, high = np.floor(places.min(axis=0)), np.ceil(places.max(axis=0))
    grid = Grid(low[0], high[1], 0.25, int((high[1] - low[1]) * 4), int((high[0] - low[0]) * 4))
    bands = np.stack(list(motion_raster(series.grounds[-1], series.scene, grid).values()))
    column, row = ((places[:, 0] - low[0]) * 4).astype(int), ((high[1] - places[:, 1]) * 4).astype(int)
    return 1000 * np.nanmean(bands[:, row, column], axis=1) / series.days[-1]


def moving(folder: Path):
    """The zone of the series whose ground moves along the surface."""
    zones = layer(folder, "zones", "series.gpkg")
    (number,) = np.flatnonzero(zones["motion_zone"] == "M001")
    return zones.iloc[number]


def test_ground_that_creeps_is_a_zone_with_an_alert_that_heights_do_not_raise(runs):
    out, (_, found, heights) = runs
    zone = moving(out / "motion")
    assert zone["found_by"] in ("motion", "both")
    assert (zone["kind"] == "sliding") == (zone["found_by"] == "motion")
    assert np.isnan(zone[["vol_loss_m3", "vol_gain_m3"]].astype(float)).all() == (zone["kind"] == "sliding")
    assert zone["alert_reason"].startswith(("along the surface: rate", "motion along the surface"))
    assert abs(zone["motion_off_dip_deg"]) < 15
    by_heights = layer(out / "heights", "zones", "series.gpkg")
    assert zone["alert_level"] > by_heights["alert_level"].max()
    assert set(by_heights["found_by"]) <= {"heights"}
    assert found.figures["moving_zone_count"] == 1
    assert "moving_zone_count" not in heights.figures
    course = layer(out / "motion", "series", "series.gpkg")
    own = course[course["zone_id"] == zone["zone_id"]]
    assert own["motion_m"].is_monotonic_increasing


def test_the_zone_s_velocity_is_the_true_one(creeping, runs):
    series, _ = creeping
    zone = layer(runs[0] / "motion", "zones").iloc[-1]
    inner = zone.geometry.buffer(-1.25)
    points = geopandas.GeoSeries([inner]).sample_points(400, rng=1).explode(index_parts=False)
    places = np.column_stack([points.x, points.y])
    found = np.array([zone[f"velocity_{axis}_mm_day"] for axis in ("east", "north", "up")])
    error = np.array([zone[f"velocity_{axis}_err_mm_day"] for axis in ("east", "north", "up")])
    true = true_velocity(series, places)
    assert np.linalg.norm(true) > 0.8
    assert (np.abs(found - true) < 3 * error + 0.1 * np.linalg.norm(true)).all()


def test_layers_have_a_row_a_survey_and_the_days_on_which_it_is_shown(runs):
    folder = runs[0] / "motion"
    for name in ("vectors", "steps", "zones"):
        table = layer(folder, name)
        assert set(table["epoch"]) == {"2024-06-30", "2024-08-29"}
        last = table[table["epoch"] == "2024-08-29"].iloc[0]
        assert (last["time_from"], last["time_to"]) == (
            pd.Timestamp("2024-07-01"),
            pd.Timestamp("2024-08-29"),
        )
        assert (table["length_err_m"] > 0).all()
    velocities = layer(folder, "velocities")
    assert len(velocities) > 3
    assert (velocities["length_mm_day"] > 2 * velocities["length_err_mm_day"]).all()
    zones = layer(folder, "zones")
    assert zones["length_m"].iloc[1] > zones["length_m"].iloc[0] > 0


@pytest.mark.parametrize(("way", "said"), [(0.02, True), (0.002, False), (0.004, False)])
def test_a_registration_that_was_pulled_is_said(way, said):
    """Not where it is by less than half a centimetre."""
    taken_off, covariance = np.zeros((3, 3)), np.full((3, 3, 3), np.nan)
    taken_off[2, 0], covariance[2] = way, 1e-6 * np.eye(3)
    known = Registered.shift(0.002, 0.001)
    references = References(taken_off, covariance, np.array([False, False, True]), np.zeros(3), ())
    field = SimpleNamespace(references=references, surveys=Surveys(np.arange(3.0), (known,) * 3))
    sentences: list[str] = []
    progress = Progress()
    progress.info = sentences.append  # type: ignore[method-assign]
    series_motion._say_what_was_pulled(field, progress)  # type: ignore[arg-type]
    assert len(sentences) == said
    assert all("as one by up to 2.0 cm" in sentence for sentence in sentences)


def test_rasters_are_of_the_last_survey_against_the_first(runs):
    folder = runs[0] / "motion"
    with rasterio.open(folder / "displacement.tif") as raster:
        dip = raster.read(raster.descriptions.index("motion down the dip") + 1, masked=True)
        assert raster.tags()["EPOCH_TO"] == "2024-08-29"
        opacity = raster.read(raster.count, masked=True)
    assert 0.1 < dip.max() < 0.36
    arrows = layer(folder, "vectors")
    assert np.ma.sum(opacity == 255) == np.sum(arrows["epoch"] == "2024-08-29") > 3
    assert (opacity.mask == dip.mask).all()
    with rasterio.open(folder / "smallest_motion.tif") as raster:
        assert 0.01 < np.ma.median(raster.read(1, masked=True)) < 0.2


def test_the_record_says_what_was_seen_and_the_report_shows_it(runs):
    folder = runs[0] / "motion"
    record = json.loads((folder / "run.json").read_text())
    assert record["parameters"]["displacement_step"] == {"displacement": True}
    assert record["motion"]["measured_share"] > 0.5
    assert record["motion"]["pairs_made"] == [[0, 2], [1, 2]]  # that of the first two surveys was kept
    assert record["limits"][1].startswith("Motion along the surface is measured on")
    name = moving(folder)["zone_id"]
    assert "motion_m" in record["course"][name][0]
    text = (folder / "report.html").read_text()
    assert "Motion along the surface of 1 zones against the first survey" in text
    assert f"{name} moved by" in text
    assert "Motion along the surface of" not in (runs[0] / "heights" / "report.html").read_text()


def test_ids_stay_when_a_survey_is_added(creeping, runs, tmp_path):
    _, paths = creeping
    monitor_series(surveys(paths)[:2], tmp_path / "out", KEPT, roi=paths["roi"])
    before, after = (layer(folder, "zones") for folder in (tmp_path / "out", runs[0] / "motion"))
    assert set(before["motion_zone"]) <= set(after["motion_zone"])
    for name in set(before["motion_zone"]):
        a, b = (table[table["motion_zone"] == name].geometry.iloc[0] for table in (before, after))
        assert a.intersection(b).area > 0.5 * a.area


def other_files(folder: Path) -> dict[str, bytes]:
    """All products but those of motion, and those that tell when they were made."""
    left = {*SERIES_MOTION_OUTPUTS, "run.json", "report.html"}
    return {
        str(path.relative_to(folder)): path.read_bytes()
        for path in folder.rglob("*")
        if path.is_file() and path.name not in left and "motion" not in path.name
    }


def test_products_of_heights_are_the_same_bytes_with_motion(runs):
    out, _ = runs
    with_motion, without = other_files(out / "motion"), other_files(out / "heights")
    assert set(with_motion) == set(without)
    zones = {"series.gpkg", "series.csv", "series.png"}  # which have a zone more
    assert {name for name in without if with_motion[name] != without[name]} <= zones
    assert len([name for name in without if name.endswith(".tif")]) >= 11


def test_where_nothing_is_seen_to_move_all_products_are_the_same_bytes(tmp_path):
    for number in range(3):
        plane(tmp_path / f"2024-0{number + 1}-01.laz", seed=number, bump=0.1 * number)
    from slopewatch.engine.epochs.manifest import epochs_of

    for name, step in (("on", DisplacementStepParameters()), ("off", OFF)):
        monitor_series(epochs_of(tmp_path), tmp_path / name, replace(FIXED, displacement_step=step))
    assert (tmp_path / "on" / "displacement.gpkg").is_file()
    assert layer(tmp_path / "on", "zones").empty
    on, off = (other_files(tmp_path / name) for name in ("on", "off"))
    assert {name for name in on if on[name] != off[name]} <= {"series.gpkg"}  # which names the run
    tables = [layer(tmp_path / name, "zones", "series.gpkg").drop(columns="run_id") for name in ("on", "off")]
    assert len(tables[0]) == 1
    assert_geodataframe_equal(*tables)
    assert set(on) == set(off)


def test_surveys_that_stay_on_the_disk_show_the_same_motion(creeping, tmp_path, monkeypatch):
    _, paths = creeping
    held = monitor_series(surveys(paths)[:3], tmp_path / "held", KEPT, roi=paths["roi"])
    monkeypatch.setattr(pair, "MAX_HELD_POINTS", 60_000)
    stored = monitor_series(surveys(paths)[:3], tmp_path / "stored", KEPT, roi=paths["roi"])
    for name in ("displacement_vectors", "displacement", "smallest_motion"):
        assert stored.outputs[name].read_bytes() == held.outputs[name].read_bytes(), name
    assert not list((tmp_path / "stored").rglob("*points*"))


def test_two_surveys_are_in_memory_at_a_time():
    class Epoch:
        def __init__(self, number: int) -> None:
            self.number, self.reads = number, 0

        def points(self) -> np.ndarray:
            self.reads += 1
            return np.full((1, 3), self.number)

    epochs = [Epoch(number) for number in range(4)]
    held = series_motion._Held(epochs)  # type: ignore[arg-type]
    for earlier, later in ((0, 1), (0, 2), (0, 3), (2, 3), (1, 2)):
        first, second = held(earlier, later)
        assert (first[0, 0], second[0, 0]) == (earlier, later)
        assert len(held._held) == 2
    assert [epoch.reads for epoch in epochs] == [1, 2, 2, 1]
