"""The report, table and record of a series: the same figures everywhere."""

from __future__ import annotations

import csv
import json
import re

import geopandas
import numpy as np
import pytest
from slopewatch.engine.report.compose import write_report


def test_the_report_has_the_figures_of_the_record(runs):
    out, found = runs
    record, zones = found[-1][1], found[-1][2]
    page = (out / "report.html").read_text(encoding="utf-8")
    figures = re.findall(r'<data value="([^"]+)" data-from="/([^"]+)"', page)
    for value, place in figures:
        recorded = record
        for key in place.split("/"):
            recorded = recorded[int(key)] if isinstance(recorded, list) else recorded[key]
        assert float(value) == recorded
    assert {"metrics/fastest_rate_mm_day", "coverage/0/points_m2", "zones/0/rate_mm_day", "zones/0/rate_err"} <= {
        p for _, p in figures
    }
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
    said = f"S001 changed by {last['dz_mean_m']:+.3f} m"
    assert said in page


def test_a_report_of_a_series_from_before_courses_were_kept(runs, tmp_path):
    out, found = runs
    record = {k: v for k, v in found[-1][1].items() if k not in ("course", "dates")}
    (tmp_path / "run.json").write_text(json.dumps(record))
    assert "Survey by survey" not in write_report(tmp_path).read_text(encoding="utf-8")
    assert "Survey by survey" in (out / "report.html").read_text(encoding="utf-8")


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
