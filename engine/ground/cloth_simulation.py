"""Cloth Simulation Filter (Zhang et al. 2016, doi:10.3390/rs8060501), with the result of its authors' library.

After CSF 1.1.7 (https://github.com/jianboqi/CSF), Copyright 2017 State Key Laboratory of Remote Sensing Science,
Institute of Remote Sensing Science and Engineering, Beijing Normal University; licensed under Apache-2.0.
"""

from __future__ import annotations

import numpy as np

from ...interface.parameters import GroundParameters
from ..core.arrays import Bool, Float
from ..geometry.columns import greatest, least
from .cloth_kernels import ABSENT, FRAME, MOVABLE, Byte, neighbours, pin_hanging, settle

_MARGIN = 2
"""Particles of the cloth beyond the points on each side."""
_START_M, _GRAVITY = 0.05, 0.2
_SINGLE = (0, 0.3, 0.51, 0.657, 0.7599, 0.83193, 0.88235, 0.91765, 0.94235, 0.95965, 0.97175, 0.98023, 0.98616,
           0.99031, 0.99322, 1.0)  # fmt: skip
_DOUBLE = (0, 0.3, 0.42, 0.468, 0.4872, 0.4949, 0.498, 0.4992, 0.4997, 0.4999, 0.4999, 0.5, 0.5, 0.5, 0.5, 0.5)
"""Shares of a height difference that as many pulls as the rigidness close: of a fixed particle, of a movable one."""


def near_cloth(xyz: Float, parameters: GroundParameters, threshold: float) -> Bool:
    """(n,) whether points (n, 3) in metres lie within ``threshold`` (m) of the settled cloth, vertically.

    Without numba it takes two hundred times as long.
    """
    resolution = parameters.cloth_resolution
    upside = -xyz[:, 2]
    low, high = least(xyz[:, :2]), greatest(xyz[:, :2])
    corner = low - _MARGIN * resolution
    columns, rows = (int(n) + 2 * _MARGIN for n in np.floor((high - low) / resolution))
    row = columns + 2 * FRAME
    state = np.pad(np.full((rows, columns), MOVABLE, np.uint8), FRAME, constant_values=ABSENT).ravel()
    ground = np.pad(_cell_heights(xyz, corner, (rows, columns), resolution), FRAME, constant_values=np.nan).ravel()
    ground, seen = _searched(ground, _next_heights(ground.reshape(-1, row)).ravel(), state, row)
    cloth = np.full(len(ground), upside.max() + _START_M)
    rigidness = min(parameters.rigidness, len(_SINGLE) - 1)
    pull = np.array([_SINGLE[rigidness], _DOUBLE[rigidness]])
    squared = parameters.time_step * parameters.time_step
    weight = (-_GRAVITY * squared) * squared
    settle(cloth, cloth.copy(), ground, state, row, pull, weight, parameters.iterations)
    if parameters.slope_smoothing:
        pin_hanging(cloth, ground, state, seen, row)
    place = xyz[:, :2] - corner
    cell = (place / resolution).astype(np.int64)
    x, y = ((place - cell * resolution) / resolution).T
    i = (cell[:, 1] + FRAME) * row + cell[:, 0] + FRAME
    height = cloth[i] * (1 - x) * (1 - y) + cloth[i + row] * (1 - x) * y
    height = height + cloth[i + row + 1] * x * y + cloth[i + 1] * x * (1 - y)
    near: Bool = np.abs(height - upside) < threshold
    return near


def _cell_heights(xyz: Float, corner: Float, shape: tuple[int, int], resolution: float) -> Float:
    """(rows, columns) height, upside down, of the point nearest to each particle in its cell; NaN without one."""
    cell = ((xyz[:, :2] - corner) / resolution + 0.5).astype(np.int64)
    distance = np.square(xyz[:, :2] - (corner + cell * resolution))
    distance = distance[:, 0] + distance[:, 1]
    flat = cell[:, 1] * shape[1] + cell[:, 0]
    nearest = np.full(shape[0] * shape[1], np.inf)
    np.minimum.at(nearest, flat, distance)
    chosen = np.flatnonzero(distance == nearest[flat])[::-1]  # of equals the first, which is written last
    heights = np.full(len(nearest), np.nan)
    heights[flat[chosen]] = -xyz[chosen, 2]
    return heights.reshape(shape)


def _next_heights(heights: Float) -> Float:
    """(rows, columns) heights; instead of NaN the next one in its row (right, then left) or column (down, then up)."""
    filled = heights.copy()
    for found in (
        _last_known(heights[:, ::-1])[:, ::-1],
        _last_known(heights),
        _last_known(heights.T).T,
        _last_known(heights[::-1].T).T[::-1],
    ):
        np.copyto(filled, found, where=np.isnan(filled))
    return filled


def _last_known(heights: Float) -> Float:
    """(rows, columns) heights, each NaN replaced by the last height before it in its row; NaN without one."""
    known = np.where(np.isnan(heights), 0, np.arange(heights.shape[1]))
    return np.take_along_axis(heights, np.maximum.accumulate(known, axis=1), axis=1)


def _searched(heights: Float, filled: Float, state: Byte, row: int) -> tuple[Float, Byte]:
    """(n,) heights without NaN in the cloth; and the particles that the library leaves marked as seen.

    A particle without any height in its row and column gets the first one from neighbour to neighbour. The library
    marks on this search which particles it has seen, but neither all of them nor all anew for the next search.
    """
    seen = np.zeros(len(heights), np.uint8)
    tied = neighbours(row).tolist()
    for i in np.flatnonzero(np.isnan(filled) & (state == MOVABLE)).tolist():
        seen[i] = 1
        queue = [i + far for far in tied if state[i + far] == MOVABLE]
        done = 0
        while np.isnan(heights[queue[done]]):
            for far in tied:
                near = queue[done] + far
                if state[near] == MOVABLE and not seen[near]:
                    seen[near] = 1
                    queue.append(near)
            done += 1
        filled[i] = heights[queue[done]]
        seen[queue] = 0
    return filled, seen
