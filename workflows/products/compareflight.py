"""The files of a flight compared with its plan."""

from __future__ import annotations

import csv
import dataclasses

import geopandas as gpd
import numpy as np
import shapely

from ...engine.core.staged_outputs import atomic_output
from ...engine.flight.comparison import Comparison
from ...engine.maps.flight_styles import flight_lines_qml
from ...engine.vector.geopackage import Layer, write_layers
from ..run import Run

COMPARISON_OUTPUTS = ("comparison.gpkg", "lines.csv", "strips.csv")


def write_comparison(run: Run, made: Comparison) -> None:
    """Write lines, the way flown and places as layers, and lines and strips as tables; ``run`` gets their paths."""
    layers = [Layer(_places(made), "places", "", "Polygon")]
    if made.lines:
        layers = [
            Layer(_lines(made), "lines", flight_lines_qml(), "LineString Z"),
            Layer(_tracks(made), "flown", "", "LineString Z"),
            *layers,
        ]
    write_layers(run.stage.path("comparison.gpkg"), layers)
    run.outputs["comparison"] = run.stage.final("comparison.gpkg")
    tables = {"strips": [dataclasses.asdict(strip) for strip in made.strips]}
    if made.lines:
        tables["lines"] = _lines(made).drop(columns="geometry").to_dict("records")
    for name, rows in tables.items():
        with atomic_output(run.stage.path(f"{name}.csv")) as partial, partial.open("w", newline="") as stream:
            table = csv.DictWriter(stream, list(rows[0]) if rows else ["number"])
            table.writeheader()
            table.writerows({k: _cell(v) for k, v in row.items()} for row in rows)
        run.outputs[name] = run.stage.final(f"{name}.csv")


def _cell(value: object) -> object:
    if isinstance(value, float):
        return round(value, 3) if np.isfinite(value) else ""
    return value


def _lines(made: Comparison) -> gpd.GeoDataFrame:
    """One row a planned line: how it was flown."""
    table = {
        "line": [line.number for line in made.lines],
        "state": [line.state for line in made.lines],
        "flown_share": [line.share for line in made.lines],
        "aside_m": [line.aside for line in made.lines],
        "aside_most_m": [line.aside_most for line in made.lines],
        "above_m": [line.above for line in made.lines],
        "above_most_m": [line.above_most for line in made.lines],
        "over_ground_m": [line.over_ground for line in made.lines],
    }
    shapes = [shapely.LineString(line) for line in made.promised.lines]
    return gpd.GeoDataFrame(table, geometry=shapes, crs=made.promised.crs)


def _tracks(made: Comparison) -> gpd.GeoDataFrame:
    shapes = [shapely.LineString(track.xyz) for track in made.tracks]
    return gpd.GeoDataFrame({"track": range(1, len(shapes) + 1)}, geometry=shapes, crs=made.promised.crs)


def _places(made: Comparison) -> gpd.GeoDataFrame:
    """One row a place: densities promised and reached, and whether it fell short."""
    grid, returns, ground = made.promised.grid, made.returns, made.ground
    rows, columns = np.nonzero(np.isfinite(made.promised.returns))
    west, north = grid.west + columns * grid.cell, grid.north - rows * grid.cell
    judged = returns if ground is None else ground
    unknown = np.full(len(rows), np.nan)
    table = {
        "returns_promised_m2": returns.promised[rows, columns],
        "returns_reached_m2": returns.reached[rows, columns],
        "ground_promised_m2": made.promised.ground[rows, columns],
        "ground_reached_m2": unknown if ground is None else ground.reached[rows, columns],
        "judged": judged.judged[rows, columns].astype(int),
        "short": judged.short[rows, columns].astype(int),
    }
    with np.errstate(invalid="ignore", divide="ignore"):
        table["reached_share"] = judged.reached[rows, columns] / judged.promised[rows, columns]
    table["reached_share"][~np.isfinite(table["reached_share"])] = np.nan
    squares = shapely.box(west, north - grid.cell, west + grid.cell, north)
    return gpd.GeoDataFrame(table, geometry=squares, crs=made.promised.crs)
