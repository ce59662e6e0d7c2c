"""A series of simulated surveys through the whole flow, against the simulation's truth."""

from __future__ import annotations

import csv
import json
import re
import shutil
from dataclasses import replace
from datetime import date, datetime, timedelta
from itertools import pairwise
from pathlib import Path
from xml.etree import ElementTree

import geopandas
import laspy
import numpy as np
import pytest
import rasterio
from affine import Affine
from pyproj import CRS
from rasterio.features import geometry_mask
from slopewatch.engine.core.errors import InputError
from slopewatch.engine.core.progress import Progress
from slopewatch.engine.epochs.epoch import Epoch
from slopewatch.engine.epochs.manifest import epochs_of
from slopewatch.engine.grid.grid import Grid
from slopewatch.engine.report.compose import write_report
from slopewatch.interface.parameters import (
    ChangeParameters,
    GridChangeParameters,
    InputParameters,
    RegistrationParameters,
    SeriesParameters,
    SurveyParameters,
)
from slopewatch.simulation.surveys.series import Creep, Settling, simulate_series, survey_days, write_series
from slopewatch.workflows import series_preparation
from slopewatch.workflows.products.series import SERIES_OUTPUTS
from slopewatch.workflows.series import monitor_series
from slopewatch.workflows.settings import SeriesSettings

READY = SeriesSettings(series=SeriesParameters(ground_ready=True), change=GridChangeParameters(cell=0.25))
STEPS = ("extract_ground", "register_pair", "epoch_cells")


@pytest.fixture(scope="module")
def simulated(tmp_path_factory):
    parameters = SurveyParameters(seed=3, points=26_000, length=20.0, height=7.0, vegetation=0.2, offset=0.05)
    laws = (Creep(-0.01, 15.0), Creep(0.004), Settling(-0.5, 40.0))
    series = simulate_series(parameters, survey_days(5, 30), laws, half_axes=(1.8, 1.4))
    return series, write_series(series, tmp_path_factory.mktemp("series"), ground_only=True)


def surveys(paths) -> list[Epoch]:
    days = [name for name in paths if name[:4].isdigit()]
    return [Epoch(paths[day], date.fromisoformat(day)) for day in days]


class Counted:
    """Which steps ran, in the order of their calls."""

    def __init__(self, patch: pytest.MonkeyPatch) -> None:
        self.calls: list[str] = []
        for name in STEPS:
            patch.setattr(series_preparation, name, self._counting(name, getattr(series_preparation, name)))

    def _counting(self, name, function):
        def run(*arguments, **options):
            self.calls.append(name)
            return function(*arguments, **options)

        return run


@pytest.fixture(scope="module")
def runs(simulated, tmp_path_factory):
    """The first four surveys, then all five into the same folder."""
    _, paths = simulated
    out = tmp_path_factory.mktemp("out") / "of the slope"
    found = []
    for count in (4, 5):
        with pytest.MonkeyPatch.context() as patch:
            counted = Counted(patch)
            done = monitor_series(surveys(paths)[:count], out, READY, roi=paths["roi"])
            outputs, metrics = done.outputs, done.figures
        record = json.loads((out / "run.json").read_text())
        zones = geopandas.read_file(out / "series.gpkg", layer="zones")
        found.append((counted.calls, record, zones, outputs, metrics))
    return out, found


def test_the_report_has_the_figures_of_the_record(runs):
    out, found = runs
    record, zones = found[-1][1], found[-1][2]
    page = (out / "report.html").read_text(encoding="utf-8")
    figures = re.findall(r'<data value="([^"]+)" data-from="/([^"]+)"', page)
    for value, place in figures:
        told = record
        for key in place.split("/"):
            told = told[int(key)] if isinstance(told, list) else told[key]
        assert float(value) == told
    assert {"metrics/detectable_rate_mm_day", "zones/0/rate_mm_day", "zones/0/rate_err"} <= {p for _, p in figures}
    assert [z["zone_id"] for z in record["zones"]] == list(zones["zone_id"])
    assert [z["rate_mm_day"] for z in record["zones"]] == list(zones["rate_mm_day"])
    assert "What this cannot tell you" in page
    assert record["outputs"]["report"] == "report.html"


def test_the_report_draws_and_tells_the_course_of_every_zone(runs):
    out, found = runs
    record = found[-1][1]
    with (out / "series.csv").open(newline="") as file:
        table = list(csv.DictReader(file))
    assert list(record["course"]) == [z["zone_id"] for z in record["zones"]]
    for name, rows in record["course"].items():
        own = [line for line in table if line["zone_id"] == name]
        assert [r["epoch"] for r in rows] == [line["epoch"] for line in own] == record["dates"][1:]
        for field in ("dz_mean_m", "dz_err_m", "vol_net_m3", "vol_err_m3", "rate_mm_day"):
            assert [r.get(field) for r in rows] == [float(line[field]) if line[field] else None for line in own]
    page = (out / "report.html").read_text(encoding="utf-8")
    places = re.findall(r'data-from="/(course/[^"]+/vol_net_m3)"', page)
    assert len(places) == sum("vol_net_m3" in row for rows in record["course"].values() for row in rows)
    last = record["course"]["S001"][-1]
    assert f"S001 {last['dz_mean_m']:+.3f} m and {last['vol_net_m3']:+.2f} m³" in page


def test_a_report_of_a_series_from_before_courses_were_kept(runs, tmp_path):
    out, found = runs
    record = {k: v for k, v in found[-1][1].items() if k not in ("course", "dates")}
    (tmp_path / "run.json").write_text(json.dumps(record))
    assert "Survey by survey" not in write_report(tmp_path).read_text(encoding="utf-8")
    assert "Survey by survey" in (out / "report.html").read_text(encoding="utf-8")


def read(path: Path) -> np.ndarray:
    with rasterio.open(path) as raster:
        return raster.read(1, masked=True).filled(np.nan)


def grid_of(path: Path) -> Grid:
    with rasterio.open(path) as raster:
        return Grid(raster.transform.c, raster.transform.f, raster.transform.a, *raster.shape)


def test_every_promised_output_exists(runs):
    out, found = runs
    outputs = found[1][3]
    assert all(path.stat().st_size > 0 for path in outputs.values())
    assert all((out / name).is_file() for name in SERIES_OUTPUTS)
    assert len(list((out / "cumulative").glob("*.tif"))) == len(list((out / "incremental").glob("*.tif"))) == 8
    assert not [p for p in out.rglob("*") if p.name.startswith(".") or ".part" in p.name]


def test_another_survey_computes_only_itself(runs):
    _, found = runs
    (first, record, *_), (second, again, *_) = found
    assert sorted(first) == ["epoch_cells"] * 4 + ["register_pair"] * 3
    assert second == ["register_pair", "epoch_cells"]
    made = [entry["made"] for entry in again["stages"][0]["epochs"].values()]
    assert made == [[]] * 4 + [["registration", "cells"]]
    before = record["stages"][0]["epochs"]
    assert len(before) == 4
    for name, entry in again["stages"][0]["epochs"].items():
        if name in before:
            assert {**entry, "made": []} == {**before[name], "made": []}


def test_what_was_kept_gives_the_same_bytes_as_a_fresh_run(simulated, runs, tmp_path):
    _, paths = simulated
    out, _ = runs
    monitor_series(surveys(paths), tmp_path / "fresh", READY, roi=paths["roi"])
    fresh = {p.relative_to(tmp_path / "fresh") for p in (tmp_path / "fresh").rglob("*") if p.is_file()}
    assert len([name for name in fresh if name.suffix == ".tif"]) >= 4
    for name in fresh - {Path("run.json"), Path("report.html")}:  # these tell when they were made
        assert (out / name).read_bytes() == (tmp_path / "fresh" / name).read_bytes(), name


def test_ids_stay_when_a_survey_is_added(runs):
    _, ((_, _, before, *_), (_, record, after, *_)) = runs
    assert (before["n_epochs_confirmed"] >= 2).sum() >= 3
    for _, zone in before[before["n_epochs_confirmed"] >= 2].iterrows():
        same = after[after["zone_id"] == zone["zone_id"]]
        if same.empty:
            assert record["zone_history"][zone["zone_id"]]["merged_into"]
        else:
            assert same.geometry.iloc[0].intersection(zone.geometry).area > 0.8 * zone.geometry.area
            assert same["kind"].iloc[0] == zone["kind"]


def test_zones_have_the_true_velocity_and_the_right_words(simulated, runs):
    series, _ = simulated
    out, (_, (_, _, zones, _, metrics)) = runs
    grid = grid_of(out / "velocity.tif")
    known = np.isfinite(read(out / "velocity.tif"))
    moving = [np.abs(series.true_velocity(k, grid)) > 0 for k in range(3)]
    words = {}
    for _, zone in zones.iterrows():
        inside = known & geometry_mask([zone.geometry], grid.shape, Affine(*grid.affine), invert=True)
        motion = int(np.argmax([np.count_nonzero(m & inside) for m in moving]))
        words[motion] = zone
        truth = 1000 * series.true_velocity(motion, grid)[inside].mean()
        if motion < 2:
            assert zone["rate_low"] < zone["rate_mm_day"] < zone["rate_high"]
            assert abs(zone["rate_mm_day"] - truth) <= 2.6 * zone["rate_err"]  # 99 %
            assert zone["trend"] == "steady"
        total = series.true_change(4, grid)[inside].mean()
        assert abs(zone["dz_mean_m"] - total) < 2.5 * zone["vol_err_m3"] / zone["area_m2"] + 0.003
    assert set(words) == {0, 1, 2}
    assert words[0]["onset_from"] == "2024-05-01"
    assert (words[0]["kind"], words[1]["kind"]) == ("subsidence", "uplift")
    assert words[1]["onset_from"] == ""
    assert words[2]["trend"] == "decelerating"
    assert words[0]["n_epochs_confirmed"] >= 3
    assert words[0]["velocity_class"] in ("very slow", "slow")
    assert words[0]["alert_level"] >= 2
    assert words[0]["alert_reason"].startswith(("rate", "volume"))
    assert set(zones["failure_from"]) == {""}
    assert all(note.startswith("not computable") for note in zones["failure_note"])
    assert metrics["zone_count"] == len(zones)
    assert metrics["failure_interval_count"] == 0


def test_differences_to_the_first_are_the_sums_of_the_steps(simulated, runs):
    series, _ = simulated
    out, _ = runs
    steps = [read(p) for p in sorted((out / "incremental").glob("elevation*.tif"))]
    whole = [read(p) for p in sorted((out / "cumulative").glob("elevation*.tif"))]
    for count in range(1, 5):
        total = np.sum(steps[:count], axis=0)
        both = np.isfinite(total) & np.isfinite(whole[count - 1])
        assert both.any()
        np.testing.assert_allclose(total[both], whole[count - 1][both], atol=1e-5)
    grid = grid_of(out / "velocity.tif")
    for path in out.rglob("*.tif"):
        assert grid_of(path) == grid, path
    for number, dz in enumerate(whole, 1):
        error = (dz - series.true_change(number, grid))[np.isfinite(dz)]
        assert abs(np.median(error)) < 0.005


def test_cells_are_confirmed_in_groups_only(simulated, runs):
    series, _ = simulated
    out, _ = runs
    confirmed = read(out / "epochs_confirmed.tif")
    truth = series.true_change(4, grid_of(out / "velocity.tif"))
    moved = np.abs(truth) > 0.15
    assert np.nanmean(confirmed[moved] >= 2) > 0.9
    # far from all that moved, chance alone would confirm single cells
    far = np.abs(truth) == 0
    assert np.nanmean(confirmed[far] >= 2) < 0.005


def test_rasters_say_what_time_they_are_of_and_when_they_are_shown(simulated, runs):
    series, _ = simulated
    out, _ = runs
    shown = {"cumulative": [], "incremental": []}
    for kind, spans in shown.items():
        for path in sorted((out / kind).glob("*.tif"), key=lambda p: p.stem[-10:]):
            with rasterio.open(path) as raster:
                tags = raster.tags()
            begin, end = path.stem.split("_")[-2:]
            assert (tags["EPOCH_FROM"], tags["EPOCH_TO"]) == (begin, end)
            assert begin == "2024-05-01" or kind == "incremental"
            root = ElementTree.fromstring(path.with_suffix(".qml").read_text().partition("\n")[2])
            temporal = root.find("temporal")
            assert (temporal.get("enabled"), temporal.get("mode")) == ("1", "0")
            start, stop = (datetime.fromisoformat(temporal.find(f"fixedRange/{t}").text[:19]) for t in ("start", "end"))
            assert stop.date().isoformat() == end
            if path.stem.startswith("elevation"):
                spans.append((start, stop))
    for spans in shown.values():
        assert spans[0][0].date() == series.dates[0] + timedelta(days=1)
        # side by side: no day shows two surveys or none
        assert all(later[0] - before[1] == timedelta(seconds=1) for before, later in pairwise(spans))


def test_table_is_the_same_as_csv_and_as_a_layer(runs):
    out, (_, (_, _, zones, *_)) = runs
    layer = geopandas.read_file(out / "series.gpkg", layer="series")
    with (out / "series.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == len(layer) == 4 * len(zones)
    for row, (_, line) in zip(rows, layer.iterrows(), strict=True):
        assert row["zone_id"] == line["zone_id"]
        assert float(row["dz_mean_m"]) == pytest.approx(line["dz_mean_m"])
        assert line["time_to"].date().isoformat() == row["epoch"]
    last = layer[layer["epoch"] == "2024-08-29"].set_index("zone_id")
    for _, zone in zones.iterrows():
        assert zone["dz_mean_m"] == last.loc[zone["zone_id"], "dz_mean_m"]
        assert zone["rate_last"] == last.loc[zone["zone_id"], "rate_mm_day"]


def test_run_record_tells_limits_transforms_and_alerts(simulated, runs):
    series, _ = simulated
    _, (_, (_, record, *_)) = runs
    assert "screens trends, it is no alarm" in record["limits"][0]
    assert len(record["alerts"]) == 5
    points = series.clouds[0].xyz[::500]
    normal = np.linalg.svd(points - points.mean(axis=0), full_matrices=False)[2][2]
    for day, true in zip(series.dates[1:], series.transforms[1:], strict=True):
        matrix = np.array(record["transforms"][day.isoformat()])
        moved = true.inverse().apply(points)
        found = moved @ matrix[:3, :3].T + matrix[:3, 3]
        assert np.abs((found - points) @ normal).max() < 0.01


def test_raw_surveys_get_their_ground_once(tmp_path):
    parameters = SurveyParameters(seed=5, points=12_000, length=12.0, height=5.0, vegetation=0.3, offset=0.02)
    series = simulate_series(parameters, survey_days(3, 60), (Creep(-0.005),), half_axes=(1.8, 1.4))
    paths = write_series(series, tmp_path / "clouds")
    settings = SeriesSettings(
        change=GridChangeParameters(cell=0.25), series=SeriesParameters(rasters_each_survey=False)
    )
    calls = []
    for count in (2, 3):
        with pytest.MonkeyPatch.context() as patch:
            counted = Counted(patch)
            monitor_series(surveys(paths)[:count], tmp_path / "out", settings, roi=paths["roi"])
        calls.append(sorted(counted.calls))
    assert calls[0] == ["epoch_cells"] * 2 + ["extract_ground"] * 2 + ["register_pair"]
    assert calls[1] == ["epoch_cells", "extract_ground", "register_pair"]
    assert len(list((tmp_path / "out" / "work").glob("*_ground.laz"))) == 3
    zones = geopandas.read_file(tmp_path / "out" / "series.gpkg", layer="zones")
    assert zones["kind"].iloc[0] == "subsidence"
    assert not (tmp_path / "out" / "cumulative").exists()
    for pipeline in (tmp_path / "out" / "work").glob("*_select.json"):
        assert ".slopewatch-part" not in pipeline.read_text()


def plane(
    path: Path, *, raised: float = 0.0, crs: int = 32651, x: float = 0.0, bump: float = 0.0, seed: int = 0
) -> Path:
    """A slope of 10 by 10 m with 12,000 points; all of it raised, or a square of 3 m in it by ``bump``."""
    rng = np.random.default_rng(seed)
    u, v = rng.uniform(0, 10, (2, 12_000))
    square = (np.abs(u - 5) < 1.5) & (np.abs(v - 5) < 1.5)
    z = 50 + 0.5 * v + rng.normal(0, 0.01, u.size) + raised + np.where(square, bump, 0)
    header = laspy.LasHeader(point_format=6, version="1.4")
    header.scales, header.offsets = [0.001] * 3, [500_000, 3_500_000, 0]
    header.add_crs(CRS.from_epsg(crs))
    las = laspy.LasData(header)
    las.x, las.y, las.z = 500_000 + x + u, 3_500_000 + v, z
    las.return_number = las.number_of_returns = np.ones(u.size, dtype=np.uint8)
    las.write(path)
    return path


FIXED = replace(READY, registration=RegistrationParameters(method="none"))


def test_a_survey_that_rose_as_a_whole_makes_no_zones(tmp_path):
    for number, raised in enumerate((0.0, 0.0, 0.2, 0.0)):
        plane(tmp_path / f"2024-0{number + 1}-01.laz", raised=raised, bump=0.1 * number, seed=number)
    progress = Progress()
    # told to be exact: else the registration's own misfit widens that survey's level instead
    exact = replace(FIXED, change=GridChangeParameters(cell=0.25, registration_error=0.005))
    monitor_series(epochs_of(tmp_path), tmp_path / "out", exact, progress=progress)
    assert [w for w in progress.warnings if w.startswith("2024-03-01: The whole overlap has risen by about 0.2")]
    zones = geopandas.read_file(tmp_path / "out" / "series.gpkg", layer="zones")
    assert len(zones) == 1
    assert zones["area_m2"].iloc[0] == pytest.approx(9.0, rel=0.2)
    assert zones["n_epochs"].iloc[0] == 3  # the biased one tells nothing
    volume_a_day = zones["rate_mm_day"].iloc[0] * zones["area_m2"].iloc[0] / 1000
    assert volume_a_day == pytest.approx(9 * 0.3 / 91, rel=0.1)


def test_no_change_gives_outputs_without_zones(tmp_path):
    for number in range(3):
        plane(tmp_path / f"2024-0{number + 1}-01.laz", seed=number)
    done = monitor_series(epochs_of(tmp_path), tmp_path / "out", FIXED)
    outputs, metrics = done.outputs, done.figures
    assert metrics["zone_count"] == metrics["highest_alert"] == 0
    assert metrics["fastest_rate_mm_day"] is None
    assert all(path.is_file() for path in outputs.values())
    assert geopandas.read_file(tmp_path / "out" / "series.gpkg", layer="series").empty


def test_own_alert_table_decides(tmp_path):
    for number in range(3):
        plane(tmp_path / f"2024-0{number + 1}-01.laz", bump=-0.2 * number, seed=number)
    metrics = monitor_series(epochs_of(tmp_path), tmp_path / "out", FIXED).figures
    table = (tmp_path / "out" / "alerts_used.csv").read_text()
    mine = tmp_path / "mine.csv"
    rows = [line for line in table.splitlines() if line[0] not in "34"]
    mine.write_text(
        "\n".join(rows).replace("2,inspect,#f2c037,2,1,60,,5,", "2,close the road,#f2c037,2,1,60,,5,") + "\n"
    )
    other = monitor_series(epochs_of(tmp_path), tmp_path / "out", FIXED, alerts=mine).figures
    assert (metrics["highest_alert"], other["highest_alert"]) == (3, 2)
    zones = geopandas.read_file(tmp_path / "out" / "series.gpkg", layer="zones")
    assert zones["alert"].tolist() == ["close the road"]
    assert (tmp_path / "out" / "alerts_used.csv").read_text() == mine.read_text()


def test_a_damaged_entry_is_made_again(tmp_path):
    for number in range(2):
        plane(tmp_path / f"2024-0{number + 1}-01.laz", seed=number)
    out = tmp_path / "out"
    monitor_series(epochs_of(tmp_path), out, FIXED)
    kept = sorted((out / "work").glob("*_cells.npz"))
    good = kept[0].read_bytes()
    kept[0].write_bytes(good[:-100] + b"x" * 100)
    next((out / "work").glob("*_transform.facts.json")).write_text("{")
    progress = Progress()
    monitor_series(epochs_of(tmp_path), out, FIXED, progress=progress)
    assert len([w for w in progress.warnings if "was damaged since it was kept and is made again" in w]) == 2
    assert kept[0].read_bytes() == good


class TestBadInput:
    """Each gets one sentence, and nothing is written."""

    @pytest.fixture
    def folder(self, tmp_path):
        (tmp_path / "clouds").mkdir()
        for number in range(3):
            plane(tmp_path / "clouds" / f"2024-0{number + 1}-01.laz", seed=number)
        return tmp_path / "clouds"

    def refused(self, folder: Path, sentence: str, settings: SeriesSettings = FIXED, **options) -> None:
        out = folder.parent / "out"
        with pytest.raises(InputError, match=sentence):
            monitor_series(epochs_of(folder), out, settings, **options)
        assert not out.exists()

    def test_other_reference_system(self, folder):
        plane(folder / "2024-04-01.laz", crs=32650, seed=9)
        self.refused(folder, r"different reference systems: 2024-01-01.laz .* 2024-04-01.laz .*reproject")

    def test_no_overlap(self, folder):
        plane(folder / "2024-04-01.laz", x=300.0, seed=9)
        self.refused(folder, "surveys of 2024-01-01 and 2024-04-01 do not overlap: .*x 500000.0 to .*x 500300.0")

    def test_the_same_cloud_twice(self, folder):
        shutil.copy(folder / "2024-01-01.laz", folder / "2024-04-01.laz")
        self.refused(folder, "are the same cloud")

    def test_one_survey(self, folder):
        for path in sorted(folder.iterdir())[1:]:
            path.unlink()
        self.refused(folder, "One survey was given; a series takes at least two")

    def test_growing_cells(self, folder):
        self.refused(folder, "adaptive.*not for a series", replace(FIXED, change=ChangeParameters(adaptive=True)))

    def test_broken_alert_table(self, folder):
        (folder.parent / "alerts.csv").write_text("level,name\n0,none\n")
        self.refused(folder, "alert table .* column colour is missing", alerts=folder.parent / "alerts.csv")

    def test_missing_alert_table(self, folder):
        self.refused(folder, "alert table .* cannot be read", alerts=folder.parent / "nothing.csv")

    def test_region_beside_the_surveys(self, folder):
        from shapely import box

        region = folder.parent / "roi.gpkg"
        geopandas.GeoDataFrame(geometry=[box(0, 0, 10, 10)], crs=32651).to_file(region)
        self.refused(folder, "no point inside the region", roi=region)

    def test_output_that_is_an_input(self, folder):
        alerts = folder / "alerts_used.csv"
        alerts.write_text("x")
        with pytest.raises(InputError):
            monitor_series(epochs_of(folder), folder, FIXED, alerts=alerts)
        assert alerts.read_text() == "x"

    def test_damaged_cloud_leaves_nothing(self, folder):
        cloud = folder / "2024-03-01.laz"
        cloud.write_bytes(cloud.read_bytes()[:20_000])
        self.refused(folder, r"2024-03-01\.laz")

    def test_cloud_without_reference_system(self, folder):
        settings = replace(FIXED, inputs=InputParameters(crs="EPSG:4326"))
        self.refused(folder, "4326|geographic|degrees", settings)
