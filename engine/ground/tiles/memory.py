"""Whether a cloud fits into memory in one piece, and what a limit that is too small is refused with."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np

from ....interface.parameters import GroundParameters
from ....interface.parameters.specification import given
from ...core.arrays import Float, Index
from ...core.errors import InputError
from ...core.machine_memory import machine_memory
from ...core.messages import shown
from ...pointcloud.header import CloudHeader
from .layout import COARSE_M, HALO_M, MIN_SIDE_M, counted, largest_tiles, tile_bytes, tiles_of
from .spool import FOUND, POINT, SURFACE

BASE_BYTES = 450_000_000
"""Memory of the program and its child processes without points."""
ONE_PIECE_POINT_BYTES = 260
"""Memory that a point takes where the cloud is extracted in one piece."""
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


def fits_in_one_piece(points: int, parameters: GroundParameters) -> bool:
    """Whether so many points within the region may be worked on at once."""
    return BASE_BYTES + ONE_PIECE_POINT_BYTES * points <= memory_limit(parameters)


def free_for_tile(points: int, area: float, parameters: GroundParameters) -> float:
    """Bytes left for a tile of a cloud with so many points on so many m²."""
    return memory_limit(parameters) - BASE_BYTES - _MASK_BYTES * points - _AREA_BYTES * area


def refuse_too_dense(cloud: Path, places: Index, counts: Float, parameters: GroundParameters) -> None:
    """Raise InputError if even the smallest tile with its halo takes more memory than the limit allows.

    Args:
        places, counts: (m, 2) and (m,) squares of a metre that hold points within the region, seen from above or in the
            slope's frame, where they are never fuller, and their points.
    """
    extent = np.ptp(places, axis=0) // COARSE_M + 1
    if float(np.prod(extent.astype(np.float64))) > _MAX_SQUARES:
        raise InputError(
            f"{shown(cloud)} spans {' x '.join(f'{COARSE_M * n:.0f}' for n in extent)} m, too much for its ground in "
            "tiles; remove stray points far away, or give a region of interest."
        )
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
            f"The ground of {shown(cloud.path)} in tiles needs {needed / 1e9:.1f} GB on the disk of {folder} while it "
            f"is found, and {free / 1e9:.1f} GB are free; free some space or choose another output folder."
        )
