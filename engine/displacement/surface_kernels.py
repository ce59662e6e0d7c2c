"""What a surface over a plane takes at each node, in a loop that numba compiles, and by numpy with the same result."""

from __future__ import annotations

import numpy as np

from ..core.arrays import Float, Index
from ..core.compiled import compiled
from ..geometry.plane_kernels import product_sums

_SUMS = 9  # of w, wx, wy, wxx, wxy, wyy, wz, wzx, wzy
_MIN_WEIGHT = 1.5  # sum of the kernel's weights (1 in its middle); on average it is 5.3
_MAX_OFF_CENTRE = 0.8  # kernel's standard deviations from a node to the mean of its points
_MIN_SPREAD = 0.15  # share of the kernel's variance that the points have in their narrowest direction


def half_gaussian(sigma: float, truncate: float) -> Float:
    """Weights (k,) of a Gaussian from its middle on, to ``truncate`` standard deviations; both sides add to 1.

    As ``scipy.ndimage.gaussian_filter`` has them. ``sigma`` is in nodes.
    """
    reach = int(truncate * sigma + 0.5)
    weights = np.exp(-0.5 / (sigma * sigma) * np.arange(-reach, reach + 1) ** 2)
    return np.asarray((weights / weights.sum())[reach:])


def _smoothed(values: Float, half: Float) -> Float:
    """(rows, columns) weighted sums over the nodes around, along one axis after the other; none lie beyond the edge.

    Outer nodes first, as in ``smoothed_planes``.
    """
    reach = len(half) - 1
    for axis in (0, 1):
        sides = [(reach, reach) if axis == k else (0, 0) for k in (0, 1)]
        wide, count = np.pad(values, sides), values.shape[axis]
        parts = [wide[at : at + count] if axis == 0 else wide[:, at : at + count] for at in range(2 * reach + 1)]
        values = half[0] * parts[reach]
        for k in range(reach, 0, -1):
            values += (parts[reach - k] + parts[reach + k]) * half[k]
    return values


Limits = tuple[float, float, float, float, float]
"""What weights are multiplied with to be 1 in the middle, the largest squared distance from a node to the mean of its
points, and their least variance in their narrowest direction, in nodes; height of the base, and distance of the nodes,
metres."""


def limits_of(sigma: float, base: float, step: float) -> Limits:
    """For a Gaussian of so many nodes, ``step`` metres apart, of heights above ``base``."""
    return 2 * np.pi * sigma**2, (_MAX_OFF_CENTRE * sigma) ** 2, _MIN_SPREAD * sigma**2, base, step


def _planes_by_numpy(
    key: Index, x: Float, y: Float, z: Float, shape: tuple[int, int], half: Float, limits: Limits
) -> Float:
    sums = product_sums(key, x, y, z, np.ones(len(x)), shape[0] * shape[1]).reshape(_SUMS, *shape)
    scale, widest, least, base, step = limits
    u = (np.arange(shape[0]) - shape[0] / 2.0)[:, None]
    v = (np.arange(shape[1]) - shape[1] / 2.0)[None, :]
    with np.errstate(invalid="ignore", divide="ignore"):
        w, sx, sy, sxx, sxy, syy, sz, sxz, syz = (_smoothed(part, half) * scale for part in sums)
        mx, my, mz = sx / w, sy / w, sz / w
        cxx, cxy, cyy = sxx / w - mx * mx, sxy / w - mx * my, syy / w - my * my
        cxz, cyz = sxz / w - mx * mz, syz / w - my * mz
        determinant = cxx * cyy - cxy * cxy
        along, across = (cyy * cxz - cxy * cyz) / determinant, (cxx * cyz - cxy * cxz) / determinant
        off = (mx - u) ** 2 + (my - v) ** 2
        narrowest = (cxx + cyy) / 2 - np.sqrt(((cxx - cyy) / 2) ** 2 + cxy**2)
        known = (w >= _MIN_WEIGHT) & (off <= widest) & (narrowest >= least)
        height = mz + along * (u - mx) + across * (v - my) + base
    values = np.stack([height, along / step, across / step])
    values[:, ~known] = np.nan
    return values


def _point_sums(key: Index, x: Float, y: Float, z: Float, shape: tuple[int, int], reach: int) -> Float:
    """(rows + 2 reach, 9 columns) sums of ``product_sums``, node after node, with rows of zeros on both sides."""
    rows, columns = shape
    sums = np.zeros((rows + 2 * reach, columns * _SUMS))
    for i in range(len(key)):
        k = key[i]
        if k < 0 or k >= rows * columns:
            raise IndexError
        row, at = reach + k // columns, k % columns * _SUMS
        sums[row, at] += 1.0
        sums[row, at + 1] += x[i]
        sums[row, at + 2] += y[i]
        sums[row, at + 3] += x[i] * x[i]
        sums[row, at + 4] += x[i] * y[i]
        sums[row, at + 5] += y[i] * y[i]
        sums[row, at + 6] += z[i]
        sums[row, at + 7] += z[i] * x[i]
        sums[row, at + 8] += z[i] * y[i]
    return sums


def _smooth_row(sums: Float, i: int, half: Float, padded: Float, found: Float) -> None:
    """``found`` (9 columns,) becomes row ``i`` of the nodes, smoothed; ``padded`` has zeros on both sides."""
    reach, wide = len(half) - 1, len(found)
    edge = reach * _SUMS
    inner, middle = padded[edge : edge + wide], sums[reach + i]
    for c in range(wide):
        inner[c] = half[0] * middle[c]
    for k in range(reach, 0, -1):
        before, behind, weight = sums[reach + i - k], sums[reach + i + k], half[k]
        for c in range(wide):
            inner[c] += (before[c] + behind[c]) * weight
    for c in range(wide):
        found[c] = half[0] * inner[c]
    for k in range(reach, 0, -1):
        off, weight = k * _SUMS, half[k]
        left, right = padded[edge - off : edge - off + wide], padded[edge + off : edge + off + wide]
        for c in range(wide):
            found[c] += (left[c] + right[c]) * weight


def _plane_row(found: Float, i: int, rows: int, limits: Limits, values: Float) -> None:
    """Row ``i`` of ``values`` from the smoothed sums (9 columns,) of its nodes."""
    scale, widest, least, base, step = limits
    columns, u = values.shape[2], i - rows / 2.0
    for j in range(columns):
        at, v = j * _SUMS, j - columns / 2.0
        values[0, i, j], values[1, i, j], values[2, i, j] = np.nan, np.nan, np.nan
        w = found[at] * scale
        if not w >= _MIN_WEIGHT:
            continue
        mx, my, mz = found[at + 1] * scale / w, found[at + 2] * scale / w, found[at + 6] * scale / w
        cxx = found[at + 3] * scale / w - mx * mx
        cxy = found[at + 4] * scale / w - mx * my
        cyy = found[at + 5] * scale / w - my * my
        uneven = (cxx - cyy) / 2
        narrowest = (cxx + cyy) / 2 - np.sqrt(uneven * uneven + cxy * cxy)
        if not ((mx - u) * (mx - u) + (my - v) * (my - v) <= widest and narrowest >= least):
            continue
        cxz = found[at + 7] * scale / w - mx * mz
        cyz = found[at + 8] * scale / w - my * mz
        determinant = cxx * cyy - cxy * cxy
        along, across = (cyy * cxz - cxy * cyz) / determinant, (cxx * cyz - cxy * cxz) / determinant
        values[0, i, j] = mz + along * (u - mx) + across * (v - my) + base
        values[1, i, j], values[2, i, j] = along / step, across / step


@compiled(_planes_by_numpy, _point_sums, _smooth_row, _plane_row)
def smoothed_planes(
    key: Index, x: Float, y: Float, z: Float, shape: tuple[int, int], half: Float, limits: Limits
) -> Float:
    """(3, rows, columns) height and rises of the plane of least squares at each node; NaN where too little is known.

    Args:
        key: (n,) number of the node that each point is nearest to, from 0 to rows x columns - 1.
        x, y: (n,) places from the grid's middle, in nodes; ``z`` (n,) heights above the base, metres.
        half: (k,) weights by distance in nodes, of ``half_gaussian``.

    Raises:
        IndexError: a point is of no node.
    """
    rows, columns = shape
    reach = len(half) - 1
    sums = _point_sums(key, x, y, z, shape, reach)
    values = np.empty((3, rows, columns))
    padded, found = np.zeros((columns + 2 * reach) * _SUMS), np.empty(columns * _SUMS)
    for i in range(rows):
        _smooth_row(sums, i, half, padded, found)
        _plane_row(found, i, rows, limits, values)
    return values
