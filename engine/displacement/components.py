"""Components of the motion over the map, where relief holds a surface in one direction only."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import ndtr

from ..core.arrays import Bool, Float, Index
from ..statistics.normal import quantile
from .least_squares import Fit
from .measure import MAX_RESIDUAL_RATIO, MAX_STANDARD_ERROR_M, Windows
from .one_direction import Component, standard_errors
from .status import Status
from .vectors import Vectors, confidence_of_each


@dataclass(frozen=True)
class OneWay:
    """Windows of one width, in the frames of their facets.

    ``number`` (k,) of each, unit ``direction`` (k, 2) along the axes, its standard error ``turn`` (k,) (radians),
    ``amount`` and standard ``error`` (k,) in it (m), ``seen`` (k,) share that both surveys see, ``width`` (m).
    """

    number: Index
    direction: Float
    amount: Float
    error: Float
    turn: Float
    seen: Float
    width: float


@dataclass(frozen=True)
class Components:
    """Windows in which relief holds one direction only, and has no vector.

    Attributes:
        number: (k,) of the window.
        direction: (k, 3) unit vector east, north, up; the motion's other component is not known.
        amount: (k,) motion in that direction, metres, positive.
        error: (k,) its standard error with the registration's, metres.
        turn: (k,) standard error of the direction in the plane of the surface, radians.
        seen: (k,) share of the window that both surveys see.
        width: (k,) of the window, metres.
        widths: how many widths of windows were looked at in each place.
    """

    number: Index
    direction: Float
    amount: Float
    error: Float
    turn: Float
    seen: Float
    width: Float
    widths: int = 1

    def significant(self, confidence: float) -> Bool:
        """(k,) whether still ground shows such a component with a probability of at most 1 - ``confidence``."""
        return np.asarray(self.p_value < 1 - confidence)

    @property
    def p_value(self) -> Float:
        """(k,) probability that still ground shows such a component in a window of any width."""
        return np.minimum(self.widths * 2 * ndtr(-self.amount / self.error), 1.0)


def held_one_way(fits: Sequence[Fit | Status | Component], windows: Windows) -> OneWay:
    """The windows of one width with a component that is as sure, and fits as well, as is asked of vectors."""
    known = [(number, fit) for number, fit in enumerate(fits) if isinstance(fit, Component)]
    number = np.array([n for n, _ in known], dtype=np.int64)
    found = [fit for _, fit in known]
    error = standard_errors(found)
    scale = np.array([fit.scale for fit in found])
    usual = windows.scale[windows.measured]
    usual = usual if len(usual) else scale
    use = error <= MAX_STANDARD_ERROR_M
    if len(usual):
        use &= scale <= MAX_RESIDUAL_RATIO * np.median(usual)
    return OneWay(
        number[use],
        np.array([fit.direction for fit in found]).reshape(-1, 2)[use],
        np.array([fit.amount for fit in found])[use],
        error[use],
        np.array([fit.turn for fit in found])[use],
        np.array([fit.seen for fit in found])[use],
        2 * windows.radius,
    )


def on_the_map(
    sizes: Sequence[OneWay], vectors: Vectors, registered: Float, taken_off: Float, confidence: float
) -> Components:
    """Of each window without a vector the component of the narrowest width that is significant, else of the widest.

    Args:
        registered: (n, 3, 3) error of the registration at all windows, m².
        taken_off: (3,) motion that was taken off the vectors, metres.
        confidence: of all widths together.
    """
    least = quantile(confidence_of_each(confidence, max(len(sizes), 1)))
    chosen: dict[int, tuple[Float, float, float, float, float, float]] = {}
    for size in reversed(sizes):
        axes = vectors.axes[size.number]
        direction = np.einsum("kj,kji->ki", size.direction, axes[:, :2])
        amount = size.amount - direction @ taken_off
        sign = np.where(amount < 0, -1.0, 1.0)
        direction, amount = direction * sign[:, None], amount * sign
        shift = np.einsum("ki,kij,kj->k", direction, registered[size.number], direction)
        error = np.sqrt(size.error**2 + shift)
        sure = amount > least * error
        for k, number in enumerate(size.number.tolist()):
            if vectors.status[number] == Status.MEASURED or (number in chosen and not sure[k]):
                continue
            figures = (float(column[k]) for column in (amount, error, size.turn, size.seen))
            chosen[number] = (direction[k], *figures, size.width)
    numbers = sorted(chosen)
    rows = [chosen[number] for number in numbers]
    amount, error, turn, seen, width = np.array([row[1:] for row in rows], dtype=np.float64).reshape(-1, 5).T
    direction = np.array([row[0] for row in rows]).reshape(-1, 3)
    return Components(np.array(numbers, dtype=np.int64), direction, amount, error, turn, seen, width, len(sizes))
