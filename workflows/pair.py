"""What must hold for two clouds to be compared."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from pyproj import CRS
from shapely.affinity import translate
from shapely.geometry.base import BaseGeometry

from ..engine.core.progress import Progress
from ..engine.epochs.comparability import _registered, refuse_other_heights
from ..engine.geometry.rigid_transform import RigidTransform
from ..engine.pointcloud.cloud import PointCloud
from ..engine.registration.register import register
from ..engine.registration.result import RegistrationResult
from ..engine.vector.area import read_roi
from ..interface.parameters import RegistrationParameters


def stable_area(path: Path | None, crs: CRS, progress: Progress) -> BaseGeometry | None:
    """The polygons known to be stable, in ``crs``."""
    if path is None:
        return None
    area = read_roi(path, crs)
    for note in area.notes:
        progress.warning(note)
    return area.geometry


def common_area(path: Path | None, first: PointCloud, transform: RigidTransform) -> BaseGeometry | None:
    """The region of interest as both epochs hold it: the later cloud was clipped before it was moved."""
    if path is None:
        return None
    area = read_roi(path, first.crs).geometry
    middle = np.array([[area.centroid.x, area.centroid.y, float(np.median(first.xyz[:, 2]))]])
    shift = (transform.apply(middle) - middle)[0]
    return area.intersection(translate(area, shift[0], shift[1]))


def known_stable(path: Path | None, first: PointCloud) -> BaseGeometry | None:
    """The polygons known to be stable as ``change.difference`` takes them."""
    return None if path is None else read_roi(path, first.crs).geometry


def register_pair(
    first: PointCloud, second: PointCloud, parameters: RegistrationParameters, stable: Path | None, progress: Progress
) -> RegistrationResult:
    """Register ``second`` to ``first`` (see ``registration.register``) and tell the user its warnings.

    Raises:
        InputError: see ``registration.register``; heights of another system or unit, farther off than is registered.
    """
    refuse_other_heights(first, second, _registered(parameters))
    area = stable_area(stable, first.crs, progress)
    result = register(
        first.xyz, second.xyz, parameters, stable=area, plants=(first.plants, second.plants), progress=progress
    )
    for warning in result.warnings:
        progress.warning(warning)
    return result
