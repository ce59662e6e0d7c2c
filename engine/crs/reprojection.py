"""Geometries of a file in the clouds' reference system."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import shapely
from numpy.typing import NDArray
from pyproj import CRS, Transformer
from pyproj.exceptions import CRSError, ProjError
from shapely.geometry.base import BaseGeometry

from ..core.errors import InputError
from .working_frame import horizontal


def reprojected(
    geometries: Sequence[BaseGeometry], declared: CRS | str, crs: CRS, subject: str, notes: list[str]
) -> NDArray[np.object_]:
    """The geometries (n,) in the horizontal part of ``crs``; a note is added where that moved them.

    Args:
        declared: the reference system that they are in.
        subject: what they are and their source, for messages: ``The area 'roi.gpkg'``.

    Raises:
        InputError: the two systems do not meet, or the geometries lie outside of where ``crs`` holds.
    """
    given = np.asarray(geometries, dtype=object)
    try:
        full = CRS.from_user_input(declared)
        own, target = horizontal(full), horizontal(crs)
        if own is None or target is None or own.equals(target, ignore_axis_order=True):
            return given
        transformer = Transformer.from_crs(own, target, always_xy=True)
        moved = shapely.transform(given, lambda xy: np.column_stack(transformer.transform(xy[:, 0], xy[:, 1])))
    except (CRSError, ProjError) as error:
        raise InputError(
            f"{subject} cannot be brought to the reference system of the cloud ({crs.name}); save it in that."
        ) from error
    if not np.isfinite(shapely.get_coordinates(moved)).all():
        raise InputError(
            f"{subject} lies outside of where the cloud's reference system ({crs.name}) holds; check the reference "
            "systems of both."
        )
    notes.append(f"{subject} was transformed from {full.name} to {target.name}.")
    return np.asarray(moved, dtype=object)
