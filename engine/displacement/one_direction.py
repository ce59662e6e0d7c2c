"""Motion in the one direction in which relief holds a surface: ridges and furrows, which slide along themselves unseen.

The direction is that of the most information; only the component of the motion in it is sought, by least squares with
the same weights, gradients from either survey and jackknife as the motion in both directions (``least_squares``).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..core.arrays import Float, Index
from .kernels import tukey
from .least_squares import TUKEY_SCALES, Fit, Region, Seen, middle_of, seen_by_both
from .status import Status

_PARAMETERS = 4  # component, offset and two tilts
_MAX_ROUNDS, _PASSES = 15, 2
_CONVERGED_M, _MAX_STEP_M = 0.0005, 0.2
_MIN_GAIN = 0.9
_MIN_BEGINNING = 2.0  # information over its standard error, below which a start is not followed: planes have none
_MIN_SCALE_M = 1e-4
_COMMON_BLOCKS = 30.0  # as in ``errors``
_MIN_BEND = 0.2


@dataclass(frozen=True)
class Gates:
    """Least ``information`` on a direction, over its standard error, and least share of a window that is ``seen``."""

    information: float
    seen: float


@dataclass(frozen=True)
class Component:
    """What least squares say of one direction in a window.

    Attributes:
        direction: (2,) unit vector along the axes of the plane.
        amount: of the motion in it, metres.
        bread, meat, white: (4, 4) as of ``least_squares.Fit``, for component, offset and tilts.
        bend: derivative of the weighted residual by the residual, mean over the mean weight.
        blocks: that were seen.
        seen: share of the window's nodes that both surveys see.
        scale: standard deviation of the residuals, metres.
        information: on the component, over its standard error.
        turn: standard error of the direction's azimuth in the plane, radians.
    """

    direction: Float
    amount: float
    bread: Float
    meat: Float
    white: Float
    bend: float
    blocks: float
    seen: float
    scale: float
    information: float
    turn: float


@dataclass(frozen=True)
class _At:
    """The nodes of a region that both surveys see, with what is asked of them more than once."""

    nodes: Seen

    @cached_property
    def weights(self) -> tuple[Float, Float, float]:
        """Tukey's weights, the residuals without offset and tilts, and their standard deviation."""
        place, whole = self.nodes.place, self.nodes.residual
        plane = np.array([middle_of(whole), 0.0, 0.0])
        for _ in range(3):
            residual = whole - place @ plane
            scale = max(1.4826 * middle_of(np.abs(residual)), _MIN_SCALE_M)
            weight = tukey(residual, TUKEY_SCALES * scale)
            weighted = place * weight[:, None]
            plane = np.linalg.lstsq(weighted.T @ place, weighted.T @ whole, rcond=None)[0]
        return weight, residual, scale

    @cached_property
    def relief(self) -> tuple[Float, Float]:
        """The rises (n, 2) of both surveys without what offset and tilts hold."""
        nodes = self.nodes
        first, later = (
            g - nodes.place @ np.linalg.lstsq(nodes.place, g, rcond=None)[0] for g in (nodes.first, nodes.later)
        )
        return first, later

    @cached_property
    def strongest(self) -> Float:
        """(2,) the direction of most information that both surveys have in common."""
        first, later = self.relief
        cross = first.T @ (self.weights[0][:, None] * later)
        return np.asarray(np.linalg.eigh((cross + cross.T) / 2)[1][:, -1])

    def blocks(self, region: Region) -> tuple[Index, int]:
        """Number of each node's block among those that are seen, and how many they are."""
        block = region.block[self.nodes.seen]
        known = np.bincount(block) > 0
        return (np.cumsum(known) - 1)[block], int(np.count_nonzero(known))


def with_component(
    fit: Fit | Status, gates: Gates, surfaces: tuple[Float, Float], region: Region, middle: tuple[int, int],
    search: tuple[float, Float | None],
) -> Fit | Status | Component:  # fmt: skip
    """The ``fit`` itself, or the component in one direction where relief does not hold it in both.

    Args:
        search: the largest motion (m), and a start (2,) that correlation gives.
    """
    if isinstance(fit, Fit):
        weak, strong = fit.information
        one_way = weak < gates.information <= strong and fit.seen >= gates.seen
    else:
        one_way = fit == Status.NO_RELIEF
    if not one_way:
        return fit
    found = fit_component(surfaces, region, middle, gates, *search)
    return fit if found is None else found


def fit_component(
    surfaces: tuple[Float, Float], region: Region, middle: tuple[int, int], gates: Gates, limit: float,
    start: Float | None = None,
) -> Component | None:  # fmt: skip
    """The component of the motion in the direction that relief holds best; None where it holds in none.

    Args:
        surfaces: of both surveys, (3, rows, columns) as ``surface.gridded``.
        middle: row and column of the region's middle.
        limit: components beyond are not followed, metres.
        start: (2,) motion that correlation gives.
    """
    still = _at(surfaces, region, middle, np.zeros(2))
    if still is None or len(still.nodes.place) < gates.seen * len(region.rows):
        return None
    found = None
    for begin in (np.zeros(2), start):
        if begin is None:
            continue
        at = _at(surfaces, region, middle, begin) if begin is start else still
        one = _from(at, surfaces, region, middle, begin, limit)
        if one is not None and one.information < gates.information:
            one = None
        if one is not None and (found is None or one.scale < _MIN_GAIN * found.scale):
            found = one
    return found


def _from(
    at: _At | None, surfaces: tuple[Float, Float], region: Region, middle: tuple[int, int], start: Float, limit: float
) -> Component | None:
    """The component from ``start`` (2,) on, where ``at`` are the nodes; None where they are too few."""
    if at is None:
        return None
    direction = at.strongest
    if _blocks_information(at, *at.blocks(region), direction) < _MIN_BEGINNING:
        return None
    amount = float(start @ direction)
    for _ in range(_PASSES):
        converged = False
        for _ in range(_MAX_ROUNDS):
            at = _at(surfaces, region, middle, amount * direction)
            if at is None:
                return None
            weight, whole = at.weights[0], at.nodes.residual
            bread = _bread(at, weight, direction)
            if _along(bread) <= 0:
                return None
            step = -float(np.linalg.solve(bread, _jacobian(at, direction).T @ (weight * whole))[0])
            amount += float(np.clip(step, -_MAX_STEP_M, _MAX_STEP_M))
            if abs(step) < _CONVERGED_M:
                converged = True
                break
            if abs(amount) > limit:
                return None
        if not converged:
            return None
        turned = at.strongest
        turned = turned if turned @ direction >= 0 else -turned
        amount, direction = amount * float(turned @ direction), turned
    at = _at(surfaces, region, middle, amount * direction)
    return None if at is None else _described(at, region, direction, amount)


def _at(surfaces: tuple[Float, Float], region: Region, middle: tuple[int, int], motion: Float) -> _At | None:
    nodes = seen_by_both(surfaces, region, middle, motion)
    return None if nodes is None else _At(nodes)


def _jacobian(at: _At, direction: Float) -> Float:
    return np.column_stack([(at.nodes.first + at.nodes.later) @ direction / 2, at.nodes.place])


def _bread(at: _At, weight: Float, direction: Float) -> Float:
    jacobian = _jacobian(at, direction)
    bread = jacobian.T @ (weight[:, None] * jacobian)
    bread[0, 0] = float(np.sum(weight * (at.nodes.first @ direction) * (at.nodes.later @ direction)))
    return np.asarray(bread)


def _along(bread: Float) -> float:
    """Information on the component, offset and tilts unknown."""
    return float(bread[0, 0] - bread[0, 1:] @ np.linalg.solve(bread[1:, 1:], bread[1:, 0]))


def _turn(at: _At, weight: Float, block: Index, count: int, direction: Float) -> float:
    """Standard error of the angle of ``direction``, radians, by a jackknife over blocks."""
    first, later = at.relief
    cross = np.empty((count, 2, 2))
    for i in range(2):
        for j in range(2):
            product = weight * (first[:, i] * later[:, j] + first[:, j] * later[:, i]) / 2
            cross[:, i, j] = np.bincount(block, product, count)
    strongest = np.linalg.eigh(cross.sum(axis=0) - cross)[1][:, :, -1]
    along, across = strongest @ direction, strongest @ np.array([-direction[1], direction[0]])
    angle = np.arctan(across / np.where(np.abs(along) > 1e-9, along, 1e-9))
    return float(np.sqrt((count - 1) / count * np.sum((angle - angle.mean()) ** 2)))


def _described(at: _At, region: Region, direction: Float, amount: float) -> Component:
    weight, residual, scale = at.weights
    jacobian, bread = _jacobian(at, direction), _bread(at, weight, direction)
    block, count = at.blocks(region)
    information = _blocks_information(at, block, count, direction)
    terms = jacobian * (weight * residual)[:, None]
    sums = np.stack([np.bincount(block, terms[:, k], count) for k in range(_PARAMETERS)], axis=1)
    parts = np.empty((count, _PARAMETERS, _PARAMETERS))
    for i in range(_PARAMETERS):
        for j in range(i + 1):
            product = jacobian[:, i] * jacobian[:, j]
            if i == 0:
                product = (at.nodes.first @ direction) * (at.nodes.later @ direction)
            parts[:, i, j] = parts[:, j, i] = np.bincount(block, weight * product, count)
    without = np.linalg.solve(bread - parts, sums[:, :, None])[:, :, 0] @ bread
    share = np.minimum(np.abs(residual) / (TUKEY_SCALES * scale), 1.0) ** 2
    slope = (1 - share) * (1 - 5 * share)
    return Component(
        direction,
        amount,
        bread,
        without.T @ without,
        jacobian.T @ (jacobian * (weight * residual)[:, None] ** 2),
        float(slope.mean() / max(weight.mean(), 1e-12)),
        float(count),
        len(residual) / len(region.rows),
        scale,
        information,
        _turn(at, weight, block, count, direction),
    )


def _blocks_information(at: _At, block: Index, count: int, direction: Float) -> float:
    """Information on the component over its own standard error."""
    first, later = (g @ direction for g in at.relief)
    parts = np.bincount(block, at.weights[0] * first * later, count)
    error = float(np.std(parts)) * np.sqrt(count)
    return float(parts.sum() / error) if error > 0 else 0.0


def standard_errors(found: Sequence[Component]) -> Float:
    """(n,) of the amounts, metres: as ``errors.covariances``, averaged with what all windows have in common."""
    if not found:
        return np.zeros(0)
    meat, bread, white = (np.stack([getattr(one, name) for one in found]) for name in ("meat", "bread", "white"))
    trace = np.trace(white, axis1=1, axis2=2)[:, None, None]
    root = np.linalg.cholesky(white + 1e-12 * trace * np.eye(_PARAMETERS))
    back = np.linalg.inv(root)
    common = (back @ meat @ np.swapaxes(back, 1, 2)).mean(axis=0)
    blocks = np.array([one.blocks for one in found])
    share = (blocks / (blocks + _COMMON_BLOCKS))[:, None, None]
    steady = share * meat + (1 - share) * (root @ common @ np.swapaxes(root, 1, 2))
    bend = np.maximum([one.bend for one in found], _MIN_BEND)
    inverse = np.linalg.inv(bread) / bend[:, None, None]
    return np.asarray(np.sqrt((inverse @ steady @ np.swapaxes(inverse, 1, 2))[:, 0, 0]))
