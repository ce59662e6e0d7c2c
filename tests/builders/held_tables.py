"""Folders of finished runs that hold tables only: a corridor of many slopes, and a series."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path
from typing import Any

import geopandas as gpd
import pandas as pd
import pyogrio
import shapely

_CRS = 32651
_Y = 3_500_000.0


def _square(number: int, side: float = 10.0) -> shapely.MultiPolygon:
    x, y = 500_000.0 + 40 * number, _Y + 15
    return shapely.MultiPolygon([shapely.box(x, y, x + side, y + side)])


def _record(folder: Path, **entries: Any) -> None:
    record = {"software": "SlopeWatch 0.2.0", "started": "2025-06-01T08:00:00+00:00", "parameters": {}, **entries}
    (folder / "run.json").write_text(json.dumps(record), encoding="utf-8")


def corridor(folder: Path, slopes: int, zones: int = 1, *, road: bool = False) -> Path:
    """A batch's folder: ``zones`` of a series on each slope, all with an alert of attention 2, 3 or 4.

    With ``road``, it names a straight centreline along y = 3500000, from which the zones have their places.
    """
    folder.mkdir(parents=True, exist_ok=True)
    rows, alerts = [], []
    for number in range(slopes * zones):
        slope = f"A{number // zones:03d}"
        zone_id = f"{slope}/series/S{number % zones + 1:03d}"
        attention = 2 + number % 3
        place = {"chain_from": 40.0 * number, "chain_to": 40.0 * number + 10, "location": f"S1 K0+{40 * number:03d}"}
        rows.append({
            "zone_id": zone_id, "slope": slope, "source": "series", "attention": attention, "kind": "uplift",
            "severity": "", "alert_level": attention, "alert": "inspect", "alert_reason": "rate", "status": "active",
            "epoch_from": "2024-01-01", "epoch_to": "2025-03-01", "area_m2": 100.0, "vol_net_m3": 12.5 + number,
            "vol_err_m3": 0.25, "rate_mm_day": 4.5, "route": "S1", "side": "left", "carriageway": "", "offset_m": 15.0,
            "review_status": "unreviewed", "reviewer": "", "remarks": "", "run_id": "193d09c104ad", **place,
        })  # fmt: skip
        alerts.append({
            "alert_id": f"{number:010d}", "slope": slope, "zone_id": zone_id, "kind": "uplift", "source": "series",
            "attention": attention, "reason": "rate", "raised_on": "2025-03-01", "last_on": "2025-03-01",
            "ended_on": "", "state": "raised", "state_reason": "", "reviewer": "", "remarks": "", **place,
        })  # fmt: skip
    shapes = [_square(number) for number in range(len(rows))]
    for name, table in (("zones", rows), ("alerts", alerts)):
        frame = gpd.GeoDataFrame(pd.DataFrame(table), geometry=shapes, crs=_CRS)
        pyogrio.write_dataframe(frame, folder / "corridor.gpkg", layer=name)
    inputs = []
    if road:
        line = shapely.LineString([(499_000, _Y), (520_000, _Y)])
        gpd.GeoDataFrame({"route": ["S1"]}, geometry=[line], crs=_CRS).to_file(folder / "road.gpkg")
        digest = hashlib.sha256((folder / "road.gpkg").read_bytes()).hexdigest()
        inputs.append({"role": "centreline", "path": str(folder / "road.gpkg"), "sha256": digest})
    # as a batch writes it: in nanoseconds
    stamp = [(folder / "corridor.gpkg").stat().st_size, (folder / "corridor.gpkg").stat().st_mtime_ns]
    _record(folder, command="batch", outputs={"corridor": "corridor.gpkg"}, inputs=inputs, tables_stamp=stamp,
            made_of="63344d5df32a06a69386a0cf775c9f9b")  # fmt: skip
    return folder


def series(folder: Path, *, run_id: str = "3d0649ffee36", started: str = "2025-06-01T08:00:00+00:00",
           levels: tuple[int, ...] = (2, 1)) -> Path:  # fmt: skip
    """A series' folder: zones S001, S002... with these levels of alert."""
    folder.mkdir(parents=True, exist_ok=True)
    rows = [
        {
            "zone_id": f"S{number + 1:03d}", "alert_level": level, "alert": "inspect", "alert_reason": "rate",
            "epoch_from": "2024-01-01", "epoch_to": "2025-03-01", "kind": "uplift", "status": "active",
            "first_seen": "2024-06-01", "last_seen": "2025-03-01", "area_m2": 100.0, "vol_net_m3": 12.5,
            "review_status": "unreviewed", "reviewer": "", "remarks": "", "run_id": run_id,
        }
        for number, level in enumerate(levels)
    ]  # fmt: skip
    frame = gpd.GeoDataFrame(pd.DataFrame(rows), geometry=[_square(n) for n in range(len(rows))], crs=_CRS)
    pyogrio.write_dataframe(frame, folder / "series.gpkg", layer="zones")
    cloud = {"role": "epoch 2024-01-01", "path": "/surveys/2024-01-01.laz", "sha256": "98ab14d2"}
    _record(folder, command="series", outputs={"series_zones": "series.gpkg"}, inputs=[cloud], run_id=run_id,
            started=started, dates=["2024-01-01", "2025-03-01"])  # fmt: skip
    return folder


def edited(package: Path, layer: str, row: int, **values: str) -> None:
    """Enter values in a row of a table, as a person does."""
    layers = {str(name): gpd.read_file(package, layer=name) for name, _ in pyogrio.list_layers(package)}
    for name, value in values.items():
        layers[layer].loc[row, name] = value
    package.unlink()
    for name, frame in layers.items():
        pyogrio.write_dataframe(frame, package, layer=name)
