"""The hazard zones of a change."""

from __future__ import annotations

from datetime import date

import numpy as np
from pyproj import CRS

from ...interface.parameters import ChangeParameters, ZoneParameters
from ..change.result import Change
from ..statistics.normal import quantile
from .extraction import Origin, Zones, extract_zones
from .footprints import Cells, Detected


def change_zones(
    change: Change,
    crs: CRS | None = None,
    parameters: ZoneParameters | None = None,
    *,
    epochs: tuple[date | None, date | None] = (None, None),
    method: str = "",
    run_id: str = "",
) -> Zones:
    """``extraction.extract_zones`` of a change; no zones where the whole overlap has moved alike.

    Their ``lod95_m`` is at 95 %, whatever confidence the change was judged with.
    """
    return extract_zones(
        cells_of(change),
        detected_of(change),
        change.grid,
        crs,
        parameters,
        registration_error=change.registration_error,
        origin=Origin(epochs, method, run_id),
    )


def method_name(parameters: ChangeParameters, direction: str) -> str:
    """How the change was taken, and along which ``direction``, for the zones' column ``method``."""
    cells = "cells that grow" if parameters.grows else parameters.cell_value
    return f"grid difference ({cells}, {direction})"


def detected_of(change: Change) -> Detected:
    """How the cells were judged."""
    return Detected(
        change.significant & (change.uniform_dz is None),
        quantile(0.95) * change.error,
        np.minimum(change.count_from, change.count_to),
        change.stable,
        change.height_to,
        None if change.explained is None or change.uniform_dz is not None else change.explained,
    )


def cells_of(change: Change) -> Cells:
    """What zones and volumes are taken from."""
    plants = None if change.plants is None else change.plants.error
    others = plants, change.plant_like, change.by_trend
    return Cells(change.dz, change.error, change.cell_area, change.partition, *others)
