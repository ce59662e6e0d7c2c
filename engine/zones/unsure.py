"""Groups of cells beyond their level that are no zones, and why: in no sum, for the eye only."""

from __future__ import annotations

from dataclasses import replace

import geopandas as gpd
import numpy as np
from numpy.typing import NDArray
from pyproj import CRS
from scipy.special import log_ndtr

from ...interface.parameters import ZoneParameters
from ..core.arrays import Bool
from ..crs.working_frame import horizontal
from ..grid.grid import Grid
from ..vector.cell_polygons import cell_polygons, table_column
from .confidence import SureGroups, confidence_of_groups
from .fields import CHANCE, KINDS, PLANTS, SEASON, SMALL, UNSURE_FIELDS
from .footprints import Cells, Detected, plain_footprints
from .groups import label_groups, without

_FEWEST_CELLS = 2  # of a group: a single cell beyond its level is what the level lets through


def unsure_frame(
    cells: Cells,
    found: Detected,
    grid: Grid,
    crs: CRS | None,
    parameters: ZoneParameters,
    groups: tuple[NDArray[np.int32], NDArray[np.int32]],
    sure: SureGroups,
) -> gpd.GeoDataFrame:
    """One row a group, the surest first; columns ``UNSURE_FIELDS`` and a MultiPolygon ``geometry``.

    ``dz_err_m`` is the standard error of the mean ``dz_mean_m``, ``confidence`` as that of zones.

    Args:
        groups: all that are large enough, and those of them beyond the error by plants.
        sure: the zones among the latter.
    """
    large, beyond_plants = groups
    labels = np.zeros(large.shape, dtype=np.int32)
    reasons: list[str] = []

    def add(own: NDArray[np.int32], reason: str) -> None:
        labels[own > 0] = own[own > 0] + len(reasons)
        reasons.extend([reason] * int(own.max(initial=0)))

    for reason_of, where in ((CHANCE, beyond_plants > 0), (PLANTS, beyond_plants == 0)):
        gone = (large > 0) & (sure.labels == 0) & where
        add(without(large, np.isin(np.arange(1, large.max(initial=0) + 1), large[gone])), reason_of)
    if found.explained is not None:
        add(label_groups(cells.dz, found.explained, parameters, cells.partition, sigma=cells.error), SEASON)
    add(_small(cells, found.significant & (large == 0), parameters), SMALL)

    footprints = plain_footprints(cells, labels, len(reasons), gap=parameters.bridged_gap)
    told = confidence_of_groups(footprints, labels, cells, found.count_min, sure.correlation, least=1.0)
    mean, error, confidence = told.T
    reason = np.array(reasons, dtype=object)
    kept = (reason != SMALL) | (confidence >= parameters.minimum_confidence)
    order = np.flatnonzero(kept)[np.argsort(-confidence[kept], kind="stable")]
    number = np.zeros(len(reasons) + 1, dtype=np.int32)
    number[order + 1] = np.arange(1, len(order) + 1)
    labels = number[labels]
    sizes = np.bincount(labels.ravel(), minlength=len(order) + 1)[1:]
    values = {
        "group_id": np.array([f"U{i:03d}" for i in range(1, len(order) + 1)], dtype=object),
        "reason": reason[order],
        "kind": np.where(mean[order] < 0, *KINDS).astype(object),
        "dz_mean_m": mean[order],
        "dz_err_m": error[order],
        "area_m2": sizes * grid.cell**2,
        "confidence": confidence[order],
        "n_cells": cells.partition.parts_in_groups(labels, len(order)),
    }
    return gpd.GeoDataFrame(
        {name: table_column(values[name], kind, len(order)) for name, kind in UNSURE_FIELDS.items()},
        geometry=cell_polygons(cells.layout.on_grid(labels), len(order), grid),
        crs=horizontal(crs),
    )


def _small(cells: Cells, beyond: Bool, parameters: ZoneParameters) -> NDArray[np.int32]:
    """Groups below the least size of a zone that may be sure: errors that are alike make them less so."""
    every = replace(parameters, minimum_cells=_FEWEST_CELLS, minimum_area=cells.cell**2)
    labels = label_groups(cells.dz, beyond, every, cells.partition, sigma=cells.error)
    inside = np.flatnonzero(labels)
    group = labels.ravel()[inside]
    number = np.bincount(group)[1:]
    change = np.bincount(group, cells.dz.ravel()[inside])[1:]
    variance = np.bincount(group, cells.error.ravel()[inside].astype(np.float64) ** 2)[1:]
    places = np.log(max(cells.partition.parts_among(np.isfinite(cells.dz)), 1) / np.maximum(number, 1))
    by_chance = np.log(2.0) + log_ndtr(-np.abs(change) / np.sqrt(variance)) + places
    return without(labels, by_chance < np.log(max(1.0 - parameters.minimum_confidence, 1e-300)))
