"""The hazard zones of a change."""

from __future__ import annotations

from datetime import date

import numpy as np
from pyproj import CRS

from ...interface.parameters import ZoneParameters
from ..change.result import Change
from ..statistics.normal import quantile
from .extraction import Zones, extract_zones


def change_zones(
    change: Change,
    crs: CRS | None = None,
    parameters: ZoneParameters | None = None,
    *,
    epochs: tuple[date | None, date | None] = (None, None),
    method: str = "",
    run_id: str = "",
) -> Zones:
    """``zones.extract_zones`` of a change; no zones where the whole overlap has moved alike.

    Their ``lod95_m`` is at 95 %, whatever confidence the change was judged with.
    """
    return extract_zones(
        change.dz,
        change.significant & (change.uniform_dz is None),
        quantile(0.95) * change.error,
        change.error,
        np.minimum(change.count_from, change.count_to),
        change.grid,
        crs,
        parameters,
        registration_error=change.registration_error,
        heights=change.height_to,
        epochs=epochs,
        method=method,
        run_id=run_id,
        block=change.block,
        cell_size=change.cell_size,
        cell_area=change.cell_area,
        stable=change.stable,
        plants=None if change.plants is None else change.plants.error,
        plant_like=change.plant_like,
    )
