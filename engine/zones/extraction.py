"""Hazard zones: contiguous cells of significant change of one sign, as polygons with their figures and errors."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import date
from functools import partial
from typing import Any

import geopandas as gpd
import numpy as np
from numpy.typing import NDArray
from pyproj import CRS

from ...interface.parameters import ZoneParameters
from ..core.arrays import Float
from ..crs.working_frame import horizontal
from ..grid.grid import Grid
from ..statistics.normal import Z95
from ..vector.cell_polygons import cell_polygons, inclination, table_column
from ..vector.review_fields import UNREVIEWED
from .confidence import MIN_SURE_CONFIDENCE, sure_groups
from .fields import FIELDS, KINDS, SEVERITIES, UNSURE
from .footprints import Cells, Detected, Footprint, footprint_labels
from .groups import first_of_each, label_groups
from .unsure import unsure_frame
from .volumes import CorrelationModel, ZoneVolumes, zone_volumes


@dataclass(frozen=True)
class Origin:
    """Where zones come from: dates of both surveys, method and run."""

    epochs: tuple[date | None, date | None] = (None, None)
    method: str = ""
    run_id: str = ""


@dataclass(frozen=True)
class Zones:
    """Zones of a run, the most severe first.

    Attributes:
        frame: one row a zone; columns ``FIELDS`` and a MultiPolygon ``geometry`` in the horizontal reference system.
        labels: int32 (rows, columns); 0 outside every zone, else 1 + the zone's row in ``frame``.
        unsure: groups of cells beyond their level that are no zones (see ``unsure.unsure_frame``).
        footprints: where each zone's volume was taken, in the order of ``frame``.
        volumes: their volumes and errors, in the order of ``frame``.
        correlation: how the errors of cells are related.
    """

    frame: gpd.GeoDataFrame
    labels: NDArray[np.int32]
    footprints: tuple[Footprint, ...]
    volumes: ZoneVolumes
    correlation: CorrelationModel
    unsure: gpd.GeoDataFrame


def extract_zones(
    cells: Cells,
    found: Detected,
    grid: Grid,
    crs: CRS | None,
    parameters: ZoneParameters | None = None,
    *,
    registration_error: float = 0.0,
    origin: Origin | None = None,
) -> Zones:
    """Join significant cells of one sign into zones.

    Cells that share an edge or a corner belong together, and so do cells with a gap of at most ``bridged_gap`` between
    them in which nothing was measured in both epochs: under vegetation a surface is known in a broken pattern of cells
    only. Measured cells without significant change always divide. A polygon follows the edges of its significant cells,
    unsimplified, with its holes, so that its area is that of its cells; parts are parts of one MultiPolygon.

    The fields' meaning, where it is not plain: ``dz_p95_m`` is the 95th percentile of the magnitudes with the zone's
    sign; the volumes are those over the zone's footprint (``footprints.outline_footprints``), which is ``vol_area_m2``
    large and of whose cells the share ``vol_measured`` was measured; ``vol_loss_m3`` and ``vol_gain_m3`` are positive;
    ``vol_err_m3`` is one standard error of ``vol_net_m3`` with correlated errors (``volumes.CorrelationModel``),
    ``vol_low_m3`` to ``vol_high_m3`` its 95 % interval, ``n_eff`` the effective number of samples; ``rate_err`` is the
    standard error of ``rate_mm_day`` from the same model; ``lod95_m`` is the zone's median of ``found.level``;
    ``slope_deg`` the inclination of the plane through the zone's heights; ``confidence`` the probability that noise
    alone makes no zone as strong anywhere on the map (``confidence_after_selection``). Groups below
    ``minimum_confidence`` are no zones; a zone below 95 % has the severity ``unsure``.

    Args:
        cells: their ``error`` holds the registration's part. A part of grown cells counts as one and errs as one. To
            cells whose change may be the plants' no volume reaches out.
        found: without heights ``slope_deg`` is NULL.
        registration_error: the part of the cells' error that all share, metres.
        origin: without dates ``days`` and the rates are NULL.
    """
    parameters, origin = parameters or ZoneParameters(), origin or Origin()
    group = partial(label_groups, cells.dz, found.significant, parameters, cells.partition, sigma=cells.error)
    labels = group(plants=cells.plants)
    large = labels if cells.plants is None else group()
    count = int(labels.max(initial=0))
    sure = sure_groups(labels, count, cells, found, parameters, registration_error=registration_error)
    unsure = unsure_frame(cells, found, grid, crs, parameters, (large, labels), sure)
    labels, footprints, correlation = sure.labels, sure.footprints, sure.correlation
    count, first_cells = len(footprints), first_of_each(labels)
    inside = np.flatnonzero(labels)
    layout = cells.layout
    zone = labels.ravel()[inside].astype(np.int64) - 1

    def of_cells(values: NDArray[np.floating]) -> Float:
        return values.ravel()[inside].astype(np.float64)

    values = _statistics(
        zone,
        count,
        of_cells(cells.dz),
        of_cells(found.level),
        found.count_min.ravel()[inside],
        cell_area=grid.cell**2,
    )
    volumes = zone_volumes(footprints, cells, correlation)
    values.update(_volume_columns(volumes) | own_volumes(values, volumes))
    values["n_cells"] = cells.partition.parts_in_groups(labels, count)
    if found.heights is not None:
        values["slope_deg"] = inclination(zone, layout.flat(inside), count, of_cells(found.heights), grid)
    values["confidence"] = sure.confidence
    values["severity"] = severity_of(values["dz_p95_m"], sure.confidence, parameters)
    _add_rates(values, volumes.mean_error, origin.epochs)
    values.update({name: np.full(count, text, dtype=object) for name, text in texts_of(origin).items()})
    values["n_epochs_confirmed"] = np.ones(count, dtype=np.int64)

    order = _most_severe_first(values, first_cells)
    labels = layout.on_grid(_renumbered(labels, order))
    values = {name: column[order] for name, column in values.items()}
    values["zone_id"] = np.array([f"Z{i:03d}" for i in range(1, count + 1)], dtype=object)
    return Zones(
        frame=_frame(values, labels, grid, crs),
        labels=labels,
        footprints=tuple(footprints[i] for i in order),
        volumes=volumes.in_order(order),
        correlation=correlation,
        unsure=unsure,
    )


def _most_severe_first(values: dict[str, Any], first_cells: NDArray[np.integer]) -> NDArray[np.intp]:
    """Order of the zones: by severity, then by volume, then as they lie."""
    rank = np.array([SEVERITIES.index(s) for s in values["severity"]], dtype=np.int64)
    return np.lexsort((first_cells, -np.abs(values["vol_net_m3"]), rank))


def _renumbered(labels: NDArray[np.int32], order: NDArray[np.intp]) -> NDArray[np.int32]:
    new_label = np.zeros(len(order) + 1, dtype=np.int32)
    new_label[order + 1] = np.arange(1, len(order) + 1)
    return new_label[labels]


def _frame(values: dict[str, Any], labels: NDArray[np.int32], grid: Grid, crs: CRS | None) -> gpd.GeoDataFrame:
    count = len(values["zone_id"])
    return gpd.GeoDataFrame(
        {name: table_column(values.get(name), kind, count) for name, kind in FIELDS.items()},
        geometry=cell_polygons(labels, count, grid),
        crs=horizontal(crs),
    )


_FOOTPRINT_FIELDS = (
    "zone_id",
    "kind",
    "vol_net_m3",
    "vol_err_m3",
    "vol_low_m3",
    "vol_high_m3",
    "vol_area_m2",
    "vol_measured",
)


def footprint_frame(found: Zones, grid: Grid) -> gpd.GeoDataFrame:
    """The outlines of the footprints, a MultiPolygon a zone, with the volumes that were taken there."""
    labels = footprint_labels(found.footprints, grid.shape)
    return gpd.GeoDataFrame(
        found.frame[list(_FOOTPRINT_FIELDS)].copy(),
        geometry=cell_polygons(labels, len(found.footprints), grid),
        crs=found.frame.crs,
    )


def own_volumes(values: dict[str, Any], volumes: ZoneVolumes) -> dict[str, NDArray]:
    """The net volume of each zone's own cells, without the rest of its footprint, and its standard error, m³."""
    return {
        "zone_net_m3": values["dz_mean_m"] * values["area_m2"],
        "zone_err_m3": volumes.mean_error * values["area_m2"],
    }


def _volume_columns(volumes: ZoneVolumes) -> dict[str, NDArray]:
    return {
        "vol_loss_m3": np.maximum(-volumes.net, 0.0),
        "vol_gain_m3": np.maximum(volumes.net, 0.0),
        "vol_net_m3": volumes.net,
        "vol_err_m3": volumes.error,
        "vol_low_m3": volumes.net - Z95 * volumes.error,
        "vol_high_m3": volumes.net + Z95 * volumes.error,
        "vol_area_m2": volumes.area,
        "vol_measured": volumes.measured,
        "n_eff": volumes.samples,
    }


def _statistics(
    zone: NDArray[np.int64],
    count: int,
    dz: Float,
    lod: Float,
    points: NDArray[np.integer],
    *,
    cell_area: float,
) -> dict[str, NDArray]:
    """Figures of each of ``count`` zones from its cells' values; ``zone`` (n,) is the zone of each cell."""

    def total(weights: Float) -> Float:
        return np.bincount(zone, weights=weights, minlength=count).astype(np.float64, copy=False)

    cells = np.bincount(zone, minlength=count)
    magnitudes, levels = _sorted_by_zone(np.abs(dz), zone), _sorted_by_zone(lod, zone)
    smallest, largest = _quantile(magnitudes, cells, 0.0), _quantile(magnitudes, cells, 1.0)
    sums = total(dz)
    sign = np.sign(sums)
    least = np.full(count, np.iinfo(np.int64).max)
    np.minimum.at(least, zone, points)
    return {
        "kind": np.where(sign < 0, KINDS[0], KINDS[1]).astype(object),
        "dz_mean_m": sums / cells,
        "dz_min_m": np.where(sign < 0, -largest, smallest),
        "dz_max_m": np.where(sign < 0, -smallest, largest),
        "dz_p95_m": sign * _quantile(magnitudes, cells, 0.95),
        "area_m2": cells * cell_area,
        "lod95_m": _quantile(levels, cells, 0.5),
        "n_pts_min": least,
    }


def _sorted_by_zone(values: Float, zone: NDArray[np.int64]) -> Float:
    """Values (not negative) in order of zone, ascending within each; one sort of a joint key is ten times a lexsort."""
    step = 2.0 * float(values.max(initial=1.0))
    keys = np.sort(zone * step + values)
    return keys - np.sort(zone) * step


def _quantile(ordered: Float, cells: NDArray[np.int64], share: float) -> Float:
    """Quantile of each run of ``cells`` values in ``ordered``, linear between neighbours as numpy's default."""
    starts = np.concatenate(([0], np.cumsum(cells)[:-1])).astype(np.int64)
    position = share * (cells - 1)
    low = np.floor(position).astype(np.int64)
    high = np.minimum(low + 1, cells - 1)
    return ordered[starts + low] + (position - low) * (ordered[starts + high] - ordered[starts + low])


def texts_of(origin: Origin) -> dict[str, str]:
    first, last = (day.isoformat() if day else "" for day in origin.epochs)
    texts = {"method": origin.method, "run_id": origin.run_id, "review_status": UNREVIEWED}
    return texts | {"epoch_from": first, "epoch_to": last}


def severity_of(p95: Float, confidence: Float, parameters: ZoneParameters) -> NDArray[np.object_]:
    magnitude = np.abs(p95)
    grades = np.where(magnitude >= parameters.severity_moderate, "moderate", "low")
    grades = np.where(magnitude >= parameters.severity_high, "high", grades)
    return np.where(confidence >= MIN_SURE_CONFIDENCE, grades, UNSURE).astype(object)


def _add_rates(values: dict[str, NDArray], mean_error: Float, epochs: tuple[date | None, date | None]) -> None:
    first, last = epochs
    days = (last - first).days if first and last else 0
    if days <= 0:
        return
    values["days"] = np.full(len(values["area_m2"]), days, dtype=np.int64)
    values["rate_mm_day"] = values["dz_mean_m"] * 1000.0 / days
    values["rate_err"] = mean_error * 1000.0 / days
