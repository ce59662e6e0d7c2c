"""Profiles: heights of both epochs, change and level of detection in the cells along lines."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import date
from pathlib import Path
from typing import Any

import geopandas as gpd
import numpy as np
import shapely
from numpy.typing import NDArray
from pyproj import CRS

from ...interface.input_files import RUN_TABLE
from ..core.arrays import Float32, Index
from ..core.errors import EngineError, InputError
from ..core.input_files import open_input
from ..core.json_shapes import LARGEST
from ..core.number_text import fixed
from ..core.staged_outputs import Stage, atomic_output
from ..core.table_text import cell, text_of
from ..crs.working_frame import horizontal
from ..grid.grid import Grid
from ..statistics.layout import Layout, layout_of
from ..vector.geopackage import write_layer
from .profile_lines import GIVEN, ProfileLine

PROFILE_OUTPUTS = ("profiles.gpkg", "profiles.csv")
_COLUMNS = ("distance_m", "x", "y", "height_from_m", "height_to_m", "dz_m", "level_m", "significant")


@dataclass(frozen=True)
class Layers:
    """What profiles are taken from: arrays on ``grid``, metres, NaN where unknown.

    They are (rows, columns), or as ``layout`` holds them.
    """

    grid: Grid
    height_from: NDArray[np.floating]
    height_to: NDArray[np.floating]
    dz: NDArray[np.floating]
    level: NDArray[np.floating]
    significant: NDArray[np.bool_]
    layout: Layout | None = None

    def at(self, values: NDArray[Any], row: Index, column: Index) -> NDArray[Any]:
        """Of the cells in the rows and columns (n,)."""
        return (self.layout or layout_of(values)).at(values, row, column)


@dataclass(frozen=True)
class Profile:
    """The cells along a ``line`` in its order, one row each, with their own values as they are in the rasters.

    ``distance`` is that of the cell's centre from the line's start, measured along the line; ``x`` and ``y`` are the
    centre's coordinates. All arrays have the shape (n,), lengths are metres, NaN where unknown.
    """

    line: ProfileLine
    distance: NDArray[np.float64]
    x: NDArray[np.float64]
    y: NDArray[np.float64]
    height_from: Float32
    height_to: Float32
    dz: Float32
    level: Float32
    significant: NDArray[np.bool_]

    def facts(self) -> dict[str, Any]:
        """Its figures, for the run record and the table."""
        known = np.isfinite(self.dz)
        dz, level = self.dz[known].astype(np.float64), self.level[known].astype(np.float64)
        return {
            "name": self.line.name,
            "kind": self.line.kind,
            "zone_id": self.line.zone_id,
            "length_m": round(float(self.line.geometry.length), 4),
            "cells": len(self.dz),
            "compared_share": float(known.mean()) if len(known) else 0.0,
            "significant_share": float(self.significant.sum() / known.sum()) if known.any() else None,
            "dz_min_m": _rounded(dz.min()) if known.any() else None,
            "dz_max_m": _rounded(dz.max()) if known.any() else None,
            "dz_mean_m": _rounded(dz.mean()) if known.any() else None,
            "level_median_m": _rounded(np.median(level)) if known.any() else None,
        }


def take_profile(line: ProfileLine, layers: Layers) -> Profile:
    """The cells that the line passes, in its order.

    Values are those of the cells themselves, not interpolated: next to gaps an interpolation would invent a surface. A
    cell stands at the distance of its own centre, so that on a slope along the line its height is that of the place.
    """
    grid = layers.grid
    # a step of a cell: of two stations in one cell one is dropped, and no cell is passed over whose centre is nearest
    stations = np.append(np.arange(0.0, line.geometry.length, grid.cell), line.geometry.length)
    points = shapely.get_coordinates(shapely.line_interpolate_point(line.geometry, stations))
    column = np.floor((points[:, 0] - grid.west) / grid.cell + 1e-6).astype(np.int64)
    row = np.floor((grid.north - points[:, 1]) / grid.cell - 1e-6).astype(np.int64)
    inside = (column >= 0) & (column < grid.columns) & (row >= 0) & (row < grid.rows)
    fresh = np.append(True, (np.diff(column) != 0) | (np.diff(row) != 0))
    keep = inside & fresh
    row, column, points, stations = row[keep], column[keep], points[keep], stations[keep]
    x = grid.west + (column + 0.5) * grid.cell
    y = grid.north - (row + 0.5) * grid.cell
    ahead = _directions(line, stations)
    distance = stations + (x - points[:, 0]) * ahead[:, 0] + (y - points[:, 1]) * ahead[:, 1]
    order = np.argsort(distance, kind="stable")
    row, column = row[order], column[order]

    def along(array: NDArray[np.floating]) -> Float32:
        return np.asarray(layers.at(array, row, column), dtype=np.float32)

    return Profile(
        line=line,
        distance=distance[order],
        x=x[order],
        y=y[order],
        height_from=along(layers.height_from),
        height_to=along(layers.height_to),
        dz=along(layers.dz),
        level=along(layers.level),
        significant=layers.at(layers.significant, row, column) & np.isfinite(layers.at(layers.dz, row, column)),
    )


def missed_lines(facts: Sequence[dict[str, Any]]) -> list[str]:
    """A sentence for each line that was given and meets no ground that both surveys measured."""
    return [
        f"The profile {profile['name']!r} meets no ground that both surveys measured; check its line."
        for profile in facts
        if profile["kind"] == GIVEN and not profile["compared_share"]
    ]


def write_profiles(profiles: Sequence[Profile], crs: CRS | None, stage: Stage, stamp: date | None) -> dict[str, Path]:
    """Write ``profiles.gpkg`` (the lines with their figures) and ``profiles.csv`` (their cells); the final paths."""
    table = [profile.facts() for profile in profiles]
    frame = gpd.GeoDataFrame(
        {name: [row[name] for row in table] for name in table[0]},
        geometry=[profile.line.geometry for profile in profiles],
        crs=horizontal(crs),
    )
    for name in frame.columns:
        if frame[name].dtype == object and name not in ("name", "kind", "zone_id", frame.geometry.name):
            frame[name] = frame[name].astype("float64")
    write_layer(stage.path("profiles.gpkg"), frame, "profiles", geometry_type="LineString", stamp=stamp)
    with atomic_output(stage.path("profiles.csv")) as partial:
        partial.write_text(_csv(profiles), encoding="utf-8", errors="backslashreplace", newline="")
    return {"profiles": stage.final("profiles.gpkg"), "profiles_table": stage.final("profiles.csv")}


def read_profiles(path: Path) -> dict[str, dict[str, NDArray[np.float64]]]:
    """The columns of each profile by its name, from ``profiles.csv``.

    Raises:
        InputError: it cannot be read or is none.
    """
    found: dict[str, list[list[float]]] = {}
    try:
        with io.TextIOWrapper(open_input(path, RUN_TABLE), encoding="utf-8", newline="") as file:
            for row in csv.DictReader(file):
                values = [float(row[column]) if row[column] else np.nan for column in _COLUMNS]
                if not np.abs(np.nan_to_num(values, nan=0.0)).max() < LARGEST or not row["profile"]:
                    raise ValueError
                found.setdefault(text_of(row["profile"]), []).append(values)
    except (OSError, ValueError, KeyError, TypeError, csv.Error) as error:
        raise InputError(f"{path} is no table of profiles; make the change again.") from error
    return {name: dict(zip(_COLUMNS, np.array(rows).T, strict=True)) for name, rows in found.items()}


def _directions(line: ProfileLine, stations: NDArray[np.float64]) -> NDArray[np.float64]:
    """Unit vector of the line's direction at each station, (n, 2)."""
    corners = shapely.get_coordinates(line.geometry)
    steps = np.diff(corners, axis=0)
    lengths = np.hypot(steps[:, 0], steps[:, 1])
    steps, lengths = steps[lengths > 0], lengths[lengths > 0]
    if not len(lengths):
        raise EngineError(f"the line {line.name!r} has no length")
    part = np.searchsorted(np.cumsum(lengths), stations, side="right")
    part = np.minimum(part, len(lengths) - 1)
    return np.asarray((steps / lengths[:, np.newaxis])[part])


def _csv(profiles: Sequence[Profile]) -> str:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(("profile", "kind", "zone_id", *_COLUMNS))
    for p in profiles:
        columns = [_texts(v, 3) for v in (p.distance, p.x, p.y)]
        columns += [_texts(v, 4) for v in (p.height_from, p.height_to, p.dz, p.level)]
        columns.append(["1" if s else "0" for s in p.significant])
        texts = [cell(text) for text in (p.line.name, p.line.kind, p.line.zone_id)]
        writer.writerows([*texts, *values] for values in zip(*columns, strict=True))
    return text.getvalue()


def _texts(values: NDArray[np.floating], digits: int) -> list[str]:
    return ["" if v != v else fixed(v, digits) for v in values.tolist()]


def _rounded(value: float) -> float:
    return round(float(value), 6)
