"""What must hold for two clouds to be compared."""

from __future__ import annotations

from pathlib import Path

from pyproj import CRS
from shapely.geometry.base import BaseGeometry

from .change import Change
from .clouds import PointCloud
from .errors import InputError
from .progress import Progress
from .roi import read_roi


def require_same_crs(first: PointCloud, second: PointCloud) -> None:
    """Raise InputError unless both clouds are in the same reference system."""
    if not first.crs.equals(second.crs, ignore_axis_order=True):
        raise InputError(
            f"The epochs are in different reference systems: {first.path.name} in {first.crs.name}, "
            f"{second.path.name} in {second.crs.name}; reproject one of them, or give --crs if one is declared wrongly."
        )


def require_two_clouds(reference: Path, moving: Path) -> None:
    """Raise InputError if the two paths are one file."""
    if reference.exists() and moving.exists() and reference.samefile(moving):
        raise InputError(f"{reference} was given as both clouds; give two different ones.")


def stable_area(path: Path | None, crs: CRS, progress: Progress) -> BaseGeometry | None:
    """The polygons known to be stable, in ``crs``."""
    if path is None:
        return None
    area = read_roi(path, crs)
    for note in area.notes:
        progress.warning(note)
    return area.geometry


def warn_of_uniform_shift(change: Change, progress: Progress) -> None:
    """Name a shift of the whole overlap for what it is."""
    shift = change.uniform_dz
    if shift is not None:
        progress.warning(
            f"The whole overlap has {'risen' if shift > 0 else 'sunk'} by about {abs(shift):.3f} m: a datum or height "
            "bias, not a deformation; no zones are drawn. Check the height systems, or register first."
        )
