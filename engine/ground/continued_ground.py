"""Bare ground continued across steps and bends: what lies on a plane of adjacent bare ground is ground too.

A window that a step or an edge crosses holds two sheets, and no plane through it. Each of the sheets continues from
an adjacent window, where it lies alone. So the planes of small windows of known bare ground are continued into those
around, and where most of the returns near the ground lie on such planes, they are ground; again from there, so that a
cone is followed to its tip. Of returns in plants too few lie on any plane.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..core.arrays import Bool, Float
from ..geometry.plane_cells import Planes

MIN_KNOWN_RETURNS = 8.0
"""Returns of known ground through which a window's plane is laid."""
MAX_PLANE_DISTANCE_SCATTERS = 2.5
"""Times the scatter within which a return lies on a plane."""
MIN_ON_PLANE_SHARE = 0.6
"""Share of the returns near the ground that must lie on planes of adjacent windows."""
MIN_BEND_M, MIN_BEND_INCLINATION, MIN_BENT_SHARE = 0.1, 0.3, 0.2
"""Height over the wider ground, or inclination against it, of ground that bends, and the share of a window's returns
that must: stubble of a lawn stands lower and lies along."""
MIN_INNER_SHARE = 0.72
"""Share of the returns on a plane that lie within the scatter: 0.9 of bare ground's, 0.4 of those in plants."""
LEVEL_PULL_SHARE = 0.01
"""Pull of planes towards level, as a share of their returns."""
ROUNDS = 6


@dataclass(frozen=True)
class _Known:
    """Planes of windows: which are known, height in the middle, and inclinations by a window's side."""

    sure: Bool
    middle: Float
    along: Float
    across: Float


def continued(
    height: Float, known: Bool, near: Bool, windows: Planes, side: float, scatter: float
) -> tuple[Float, Bool]:
    """Heights (n,) over planes continued from adjacent windows, and which returns lie on them.

    Args:
        height: (n,) over one surface, m.
        known: (n,) returns of bare ground.
        near: (n,) returns near enough to the ground to take part.
        windows: of ``side`` m, each with its own returns alone.
        scatter: largest of bare ground's returns about its plane, m.
    """
    ground, residual = known.copy(), np.full(len(height), np.inf)
    everything = windows.sum(near.astype(np.float64))
    joined = np.zeros(len(height), dtype=bool)
    for _ in range(ROUNDS):
        planes = _planes(height, ground, windows, scatter)
        over, inclined = _adjacent(height, near & ~ground, windows, planes)
        on = np.abs(over) <= MAX_PLANE_DISTANCE_SCATTERS * scatter
        bends = (np.abs(height - over) > MIN_BEND_M) | (inclined > MIN_BEND_INCLINATION * side)
        number, inner, bent, known_returns, square = (
            windows.sum(np.asarray(values, dtype=np.float64))
            for values in (on, np.abs(over) <= scatter, on & bends, on | ground, np.where(on, over, 0.0) ** 2)
        )
        fits = (
            (known_returns >= np.maximum(MIN_ON_PLANE_SHARE * everything, MIN_KNOWN_RETURNS))
            & (square <= number * scatter**2)
            & (bent >= MIN_BENT_SHARE * number)
            & (inner >= MIN_INNER_SHARE * number)
        )
        new = on & fits.ravel()[windows.key]
        if not new.any():
            break
        residual[new] = over[new]
        ground |= new
        joined |= new
    return residual, joined


def _planes(height: Float, ground: Bool, windows: Planes, scatter: float) -> _Known:
    """Planes through each window's own ground; known where it scatters about it as bare ground does."""
    weight = ground.astype(np.float64)
    value = np.where(ground, height, 0.0)
    middle, along, across = windows.fit(value, weight, 0.0, LEVEL_PULL_SHARE)
    residual = np.where(ground, value - windows.at_points(middle, along, across), 0.0)
    count = windows.sum(weight)
    return _Known(
        (count >= MIN_KNOWN_RETURNS) & (windows.sum(residual**2) <= count * scatter**2), middle, along, across
    )


def _adjacent(height: Float, asked: Bool, windows: Planes, planes: _Known) -> tuple[Float, Float]:
    """(n,) height over that plane of the windows around, and of the own one, which lies closest; else infinite.

    The second is that plane's inclination by a window's side.
    """
    best, inclined = np.full(len(height), np.inf), np.zeros(len(height))
    inclination = np.hypot(planes.along, planes.across).ravel()
    index = np.flatnonzero(asked)
    rows, columns = windows.shape
    row, column = np.divmod(windows.key[index], columns)
    for up in (-1, 0, 1):
        for right in (-1, 0, 1):
            inside = (row + up >= 0) & (row + up < rows) & (column + right >= 0) & (column + right < columns)
            which = index[inside]
            key = windows.key[which] + up * columns + right
            sure = planes.sure.ravel()[key]
            which, key = which[sure], key[sure]
            plane = (
                planes.middle.ravel()[key]
                + planes.along.ravel()[key] * (windows.x[which] - up)
                + planes.across.ravel()[key] * (windows.y[which] - right)
            )
            over = height[which] - plane
            closer = np.abs(over) < np.abs(best[which])
            best[which[closer]] = over[closer]
            inclined[which[closer]] = inclination[key[closer]]
    return best, inclined
