"""Averages of the points in the cells of a cubic lattice."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..core.arrays import Float
from ..core.errors import InputError
from .columns import greatest, least

# Coordinates come in steps of a millimetre or so. Faces of the lattice at an odd fraction of its size keep them from
# lying exactly on a face, where a last digit would decide the voxel and large and small coordinates differ.
_SHIFT = 0.381966


def voxel_average(xyz: Float, size: float, more: Float | None = None) -> Float:
    """Mean of the points of each occupied voxel.

    Args:
        xyz: (n, 3) coordinates in metres, n > 0.
        size: side of a voxel in metres.
        more: (n, k) other values of each point.

    Returns:
        (m, 3) means, sorted by voxel, so that neighbours are near one another in memory; with ``more`` (m, 3 + k).

    Raises:
        InputError: the extent holds more voxels than can be numbered, which a stray point causes.
    """
    low = least(xyz) - _SHIFT * size
    extent = greatest(xyz) - low
    counts = np.floor(extent / size) + 1
    if np.prod(counts) > 2.0**62:
        raise InputError(
            f"A point cloud extends over {extent[0]:.0f} x {extent[1]:.0f} x {extent[2]:.0f} m, too far for voxels of "
            f"{size:g} m; remove stray points or give a larger registration voxel."
        )
    cell = np.floor((xyz - low) / size).astype(np.int64)
    key = (cell[:, 0] * int(counts[1]) + cell[:, 1]) * int(counts[2]) + cell[:, 2]
    order = np.argsort(key, kind="stable")
    key = key[order]
    starts = np.flatnonzero(np.concatenate([[True], key[1:] != key[:-1]]))
    members = np.diff(np.append(starts, len(key)))
    values = xyz if more is None else np.column_stack([xyz, more])
    means: Float = np.add.reduceat(values[order], starts, axis=0) / members[:, None]
    return means


def block_numbers(xyz: Float, size: float) -> NDArray[np.int64]:
    """Number of the cubic block of ``size`` metres each point (n, 3) lies in, counted from 0 without gaps."""
    cell = np.floor((xyz - least(xyz)) / size).astype(np.int64)
    spans = greatest(cell) + 1
    key = (cell[:, 0] * spans[1] + cell[:, 1]) * spans[2] + cell[:, 2]
    if np.prod(spans.astype(np.float64)) > 8 * len(xyz) + 1e6:
        return np.unique(key, return_inverse=True)[1].astype(np.int64)
    number: NDArray[np.int64] = np.cumsum(np.bincount(key) > 0) - 1
    return number[key]
