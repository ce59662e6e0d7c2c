"""Rows of the table of zones for ground that slid, and the columns of what every zone did."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import geopandas as gpd
import numpy as np
from numpy.typing import NDArray

from ...interface.parameters import ZoneParameters
from ..core.arrays import Float, Index
from ..grid.grid import Grid
from ..statistics.normal import Z95
from ..vector.cell_polygons import cell_polygons, inclination, table_column
from .extraction import Origin, own_volumes, severity_of, texts_of
from .fields import FIELDS, KINDS, SLIDING
from .footprints import Cells, Detected
from .movement import SLID, Verdict
from .movement_evidence import Measured
from .volumes import ZoneVolumes

_MIN_LENGTH_M = 1e-9


@dataclass(frozen=True)
class Slide:
    """Ground that slid.

    Attributes:
        cells: (k,) their flat indices in the grid.
        motion, covariance: (3,) east, north, up and (3, 3), metres, with the registration's error.
        normal, normal_error: its part along the normal, metres.
        confidence: that still ground shows no such zone anywhere on the map.
        sure: that it slid, and did not only sink or bulge.
        kept: likeness of its relief by that around; NaN where that was not measured.
    """

    cells: Index
    motion: Float
    covariance: Float
    normal: float
    normal_error: float
    confidence: float
    sure: float
    kept: float = float("nan")

    @classmethod
    def of(cls, cells: Index, measured: Measured, confidence: float, sure: float) -> Slide:
        """From what was measured of a zone of heights."""
        evidence = measured.evidence
        if measured.motion is None or measured.covariance is None:
            raise ValueError("nothing is known of the motion along the surface")
        return cls(
            cells, measured.motion, measured.covariance, evidence.normal, evidence.normal_error, confidence, sure,
            evidence.kept,
        )  # fmt: skip


@dataclass(frozen=True)
class Surface:
    """What zones are made of, and where they come from."""

    cells: Cells
    detected: Detected
    grid: Grid
    origin: Origin


def said_of_zones(zones: Sequence[tuple[Verdict, Measured | None]]) -> dict[str, NDArray[Any]]:
    """The columns of what zones did: lengths and angles of their motion where it is known."""
    columns = _of_motions(
        [None if m is None or m.motion is None or m.covariance is None else (m.motion, m.covariance) for _, m in zones]
    )
    evidence = [None if m is None else m.evidence for _, m in zones]
    columns["movement"] = np.array([verdict.movement for verdict, _ in zones], dtype=object)
    columns["movement_conf"] = np.array([verdict.confidence for verdict, _ in zones])
    for field, name in (("normal_m", "normal"), ("normal_err_m", "normal_error"), ("relief_kept", "kept")):
        columns[field] = np.array([np.nan if e is None else round(float(getattr(e, name)), 6) for e in evidence])
    return columns


def _of_motions(motions: Sequence[tuple[Float, Float] | None]) -> dict[str, NDArray[Any]]:
    columns = {
        name: np.full(len(motions), np.nan) for name in ("motion_m", "motion_err_m", "azimuth_deg", "plunge_deg")
    }
    for row, known in enumerate(motions):
        if known is None:
            continue
        motion, covariance = known
        length = float(np.linalg.norm(motion))
        unit = motion / max(length, _MIN_LENGTH_M)
        columns["motion_m"][row] = round(length, 6)
        columns["motion_err_m"][row] = round(float(np.sqrt(unit @ covariance @ unit)), 6)
        columns["azimuth_deg"][row] = round(float(np.degrees(np.arctan2(motion[0], motion[1])) % 360.0), 3)
        columns["plunge_deg"][row] = round(float(np.degrees(np.arctan2(-motion[2], np.hypot(*motion[:2])))), 3)
    return columns


def slide_frame(
    slides: Sequence[Slide],
    parts: Sequence[gpd.GeoDataFrame],
    labels: NDArray[np.int32],
    volumes: ZoneVolumes,
    surface: Surface,
    crs: Any,
    parameters: ZoneParameters,
) -> gpd.GeoDataFrame:
    """One row a slide; its severity and its rate are those of its motion, and it has no volume lost or gained.

    Args:
        parts: of each slide the rows of the zones of heights that are parts of it.
        labels: (rows, columns) 1 and on on the slides.
        crs: the zones' horizontal reference system.
    """
    count = len(slides)
    values = _heights(labels, count, surface) | _of_motions([(s.motion, s.covariance) for s in slides])
    confidence = np.array([s.confidence for s in slides])
    values |= {
        "kind": np.full(count, SLIDING, dtype=object),
        "movement": np.full(count, SLID, dtype=object),
        "severity": severity_of(values["motion_m"], confidence, parameters),
        "confidence": confidence,
        "movement_conf": np.array([s.sure for s in slides]),
        "normal_m": np.array([s.normal for s in slides]),
        "normal_err_m": np.array([s.normal_error for s in slides]),
        "relief_kept": np.array([s.kept for s in slides]),
        "vol_net_m3": volumes.net,
        "vol_err_m3": volumes.error,
        "vol_low_m3": volumes.net - Z95 * volumes.error,
        "vol_high_m3": volumes.net + Z95 * volumes.error,
        "vol_area_m2": volumes.area,
        "vol_measured": volumes.measured,
        "n_eff": volumes.samples,
    }
    values |= own_volumes(values, volumes)
    for name, kind in zip(("sank_m2", "bulged_m2"), KINDS, strict=True):
        values[name] = np.array([float(rows.loc[rows["kind"] == kind, "area_m2"].sum()) for rows in parts])
    texts = texts_of(surface.origin) | {"n_epochs_confirmed": 1}
    values |= {name: np.full(count, same, dtype=object) for name, same in texts.items()}
    first, last = surface.origin.epochs
    days = (last - first).days if first and last else 0
    if days > 0:
        values["days"] = np.full(count, days, dtype=np.int64)
        values["rate_mm_day"] = values["motion_m"] * 1000.0 / days
        values["rate_err"] = values["motion_err_m"] * 1000.0 / days
    return gpd.GeoDataFrame(
        {name: table_column(values.get(name), kind, count) for name, kind in FIELDS.items()},
        geometry=cell_polygons(labels, count, surface.grid),
        crs=crs,
    )


def _heights(labels: NDArray[np.int32], count: int, surface: Surface) -> dict[str, NDArray[Any]]:
    """What the heights did in each slide, over its measured cells."""
    cells, detected, grid = surface.cells, surface.detected, surface.grid
    held = cells.layout.of(labels)
    known = np.flatnonzero((held > 0) & np.isfinite(cells.dz))
    zone = held.ravel()[known].astype(np.int64) - 1
    values: dict[str, NDArray[Any]] = {
        "area_m2": np.bincount(labels.ravel(), minlength=count + 1)[1:] * grid.cell**2,
        "n_cells": cells.partition.parts_in_groups(held, count),
    }
    columns = ("dz_mean_m", "dz_min_m", "dz_max_m", "dz_p95_m", "lod95_m")
    values |= {name: np.full(count, np.nan) for name in columns}
    fewest = np.zeros(count, dtype=np.int64)
    dz, level, points = (array.ravel()[known] for array in (cells.dz, detected.level, detected.count_min))
    for number in range(count):
        own = zone == number
        if not own.any():
            continue
        mean = float(dz[own].mean())
        p95 = float(np.copysign(np.quantile(np.abs(dz[own]), 0.95), mean))
        row = (mean, float(dz[own].min()), float(dz[own].max()), p95, float(np.median(level[own])))
        for name, value in zip(columns, row, strict=True):
            values[name][number] = value
        fewest[number] = points[own].min()
    values["n_pts_min"] = fewest
    if detected.heights is not None:
        heights = detected.heights.ravel()[known].astype(np.float64)
        values["slope_deg"] = inclination(zone, cells.layout.flat(known), count, heights, grid)
    return values
