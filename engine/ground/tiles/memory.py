"""Whether a cloud fits into memory in one piece, and what a limit that is too small is refused with."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np

from ....interface.parameters import GroundParameters
from ....interface.parameters.specification import given
from ...core.arrays import Float, Index
from ...core.errors import InputError
from ...core.machine_memory import machine_memory
from ...core.messages import shown
from ...pointcloud.header import CloudHeader
from .layout import (
    COARSE_M,
    HALO_M,
    MIN_SIDE_M,
    WINDOWS_BYTES,
    counted,
    largest_tiles,
    tile_bytes,
    tiles_of,
)
from .spool import FOUND, POINT, SURFACE

MIN_MEMORY_GB = 0.35
"""Least limit that a cloud can be given."""
BASE_BYTES = 320_000_000
"""Memory of the program and its child processes without points."""
ONE_PIECE_POINT_BYTES = 170
"""Memory that a point takes where the cloud is extracted in one piece, without that of WINDOWS_BYTES."""
_MASK_BYTES, _AREA_BYTES = 3, 700
"""Memory of a point and of a square metre of the slope, whatever the tiles."""
_SPOOL_BYTES = POINT.itemsize + SURFACE.itemsize + 3 * FOUND.itemsize + 4
_WIDER_RECORD_BYTES = 16
"""Bytes that the clipped file's records have more than the cloud's, at most."""
_MAX_SQUARES = 20_000_000
"""Squares of COARSE_M in the extent of a cloud; more are an extent that a stray point makes."""


def memory_limit(parameters: GroundParameters) -> float:
    """Bytes that the extraction may take: as given, else half of the machine's."""
    limit = given(parameters.ground_memory)
    return machine_memory() / 2 if limit is None else 1e9 * limit


def shared_memory(parameters: GroundParameters, clouds: int) -> GroundParameters:
    """Parameters of one of several clouds whose ground is found at the same time within the limit."""
    share = memory_limit(parameters) / clouds / 1e9
    return replace(parameters, ground_memory=max(share, MIN_MEMORY_GB))


def fits_in_one_piece(points: int, at_once: int, parameters: GroundParameters) -> bool:
    """Whether so many points within the region may be worked on at once.

    Args:
        at_once: most points in a square of WINDOWS_WIDTH_M.
    """
    needed = BASE_BYTES + ONE_PIECE_POINT_BYTES * points + WINDOWS_BYTES * at_once
    return needed <= memory_limit(parameters)


def fits_by_squares(places: Index, counts: Float, parameters: GroundParameters) -> bool:
    """``fits_in_one_piece`` for points counted in squares of a metre, see ``refuse_too_dense``."""
    if not len(counts) or _too_wide(places):
        return False
    return fits_in_one_piece(int(counts.sum()), counted(places, counts).at_once, parameters)


def free_for_tile(points: int, area: float, parameters: GroundParameters) -> float:
    """Bytes left for a tile of a cloud with so many points on so many m²."""
    return memory_limit(parameters) - BASE_BYTES - _MASK_BYTES * points - _AREA_BYTES * area


def refuse_too_dense(cloud: Path, places: Index, counts: Float, parameters: GroundParameters) -> None:
    """Raise InputError if even the smallest tile with its halo takes more memory than the limit allows.

    What spans too much is judged once outliers are left out, see ``refuse_too_wide``.

    Args:
        places, counts: (m, 2) and (m,) squares of a metre that hold points within the region, seen from above or in the
            slope's frame, where they are never fuller, and their points.
    """
    if not len(counts) or _too_wide(places):
        return
    found, points = counted(places, counts), int(counts.sum())
    free = free_for_tile(points, len(places), parameters)
    if largest_tiles(found, free, parameters) is not None:
        return
    fullest = tiles_of(found, MIN_SIDE_M).points
    needed = memory_limit(parameters) - free + tile_bytes(found, MIN_SIDE_M, fullest, parameters)
    size = f"needs about {needed / 1e9:.2g} GB" if np.isfinite(needed) else "has too large a cloth"
    raise InputError(
        f"The ground of {shown(cloud)} ({points:,} points) {size} even in tiles of {MIN_SIDE_M} m, which hold up to "
        f"{fullest:,} points with the {HALO_M} m around them, and ground_memory allows "
        f"{memory_limit(parameters) / 1e9:.2g} GB; give more, thin the cloud, or take a coarser cloth_resolution."
    )


def refuse_too_wide(cloud: Path, places: Index) -> None:
    """Raise InputError if squares of a metre (m, 2) that hold points of the slope are spread too widely for tiles."""
    if _too_wide(places):
        raise InputError(
            f"{shown(cloud)} spans {' x '.join(str(n) for n in np.ptp(places, axis=0) + 1)} m, too much for its ground "
            "in tiles; remove stray points far away, or give a region of interest."
        )


def _too_wide(places: Index) -> bool:
    return float(np.prod(np.ptp(places, axis=0) / COARSE_M + 1.0)) > _MAX_SQUARES


def refuse_full_disk(cloud: CloudHeader, points: int, folder: Path) -> None:
    """Raise InputError if the files of the tiles and the outputs do not fit into ``folder``.

    Args:
        points: of the cloud within the region.
    """
    compressed = cloud.file_size / max(cloud.count, 1)
    needed = points * (cloud.record_length + _WIDER_RECORD_BYTES + _SPOOL_BYTES + 3 * compressed)
    free = shutil.disk_usage(folder).free
    if needed > free:
        raise InputError(
            f"The ground of {shown(cloud.path)} in tiles needs {needed / 1e9:.2g} GB on the disk of {folder} while it "
            f"is found, and {free / 1e9:.2g} GB are free; free some space or choose another output folder."
        )
