"""Motion along the surface in windows over the map, with its error, or the reason why there is none."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.special import ndtr

from ..core.arrays import Bool, Float, Index
from .errors import common_ratio, covariances
from .least_squares import PARAMETERS, Fit
from .one_direction import Component
from .status import Status

MIN_SEEN_SHARE = 0.3
"""Share of a window that both surveys must see."""
MIN_INFORMATION = 3.0
"""Standard errors by which the information on each direction must stand above zero."""
MAX_CHANCE_SHARE = 0.05
"""Of the windows that stand so far above zero, those that chance would bring there (Benjamini and Hochberg 1995)."""
MAX_RESIDUAL_RATIO = 3.0
"""Of a window's residuals to the map's median."""
MAX_STANDARD_ERROR_M = 0.1
"""Of a vector along the surface, in its weakest direction."""


@dataclass(frozen=True)
class Windows:
    """Windows of one size, in the frames of their facets.

    Attributes:
        radius: m.
        motion: (n, 3) along the dip, across and normal, metres; NaN where ``status`` is not MEASURED.
        covariance: (n, 3, 3) of it, without the registration's error, m².
        status: (n,) values of ``Status``.
        information: (n, 2) on the weakest and the strongest direction, over its standard error.
        seen: (n,) share that both surveys see.
        scale: (n,) standard deviation of the residuals, metres.
        common: (5, 5) of ``errors.common_ratio``.
    """

    radius: float
    motion: Float
    covariance: Float
    status: Index
    information: Float
    seen: Float
    scale: Float
    common: Float = field(default_factory=lambda: np.eye(PARAMETERS))

    @property
    def measured(self) -> Bool:
        return np.asarray(self.status == Status.MEASURED)


def judged(fits: Sequence[Fit | Status | Component], radius: float, blocks: int, limit: float) -> Windows:
    """Fits of windows of one size, with errors and gates.

    Args:
        blocks: of a whole window.
        limit: largest motion that was looked for, metres.
    """
    count = len(fits)
    status = np.array([_status_of(fit) for fit in fits], dtype=np.int64)
    known = [(k, fit) for k, fit in enumerate(fits) if isinstance(fit, Fit)]
    numbers = np.array([k for k, _ in known], dtype=np.int64)
    found = [fit for _, fit in known]
    windows = Windows(
        radius,
        _spread(count, numbers, [f.motion for f in found], (3,)),
        np.full((count, 3, 3), np.nan),
        status,
        _spread(count, numbers, [f.information for f in found], (2,)),
        _spread(count, numbers, [f.seen for f in found], ()),
        _spread(count, numbers, [f.scale for f in found], ()),
    )
    if not found:
        return windows
    converged = np.zeros(count, dtype=bool)
    converged[numbers] = [f.converged for f in found]
    _gate(windows, converged, limit)
    sound = windows.measured
    chosen = [fit for k, fit in known if sound[k]]
    windows = replace(windows, common=common_ratio(chosen))
    windows.covariance[sound] = covariances(chosen, [blocks * fit.seen for fit in chosen], windows.common)
    along = windows.covariance[sound][:, :2, :2]
    status[np.flatnonzero(sound)[_largest_error(along) > MAX_STANDARD_ERROR_M]] = Status.UNCERTAIN
    windows.motion[~windows.measured] = np.nan
    return windows


def _status_of(fit: Fit | Status | Component) -> Status:
    if isinstance(fit, Component):
        return Status.RELIEF_ONE_WAY
    return Status.MEASURED if isinstance(fit, Fit) else fit


def _spread(count: int, numbers: Index, values: Sequence[Float | float], shape: tuple[int, ...]) -> Float:
    whole = np.full((count, *shape), np.nan)
    if len(numbers):
        whole[numbers] = np.array(values)
    return whole


def _gate(windows: Windows, converged: Bool, limit: float) -> None:
    """Refuse what is no motion, by the first reason that holds."""
    status, (weak, strong) = windows.status, windows.information.T
    tried = int(np.count_nonzero((status != Status.NO_GROUND) & (status != Status.LITTLE_SEEN)))
    least = least_information(weak[np.isfinite(weak)], tried)
    for reason, holds in (
        (Status.LITTLE_SEEN, windows.seen < MIN_SEEN_SHARE),
        (Status.NO_RELIEF, strong < least),
        (Status.RELIEF_ONE_WAY, weak < least),
        (Status.NOT_FOUND, ~converged | (np.hypot(*windows.motion[:, :2].T) > limit)),
    ):
        status[(status == Status.MEASURED) & holds] = reason
    usual = windows.scale[status == Status.MEASURED]
    if len(usual):
        too_far = windows.scale > MAX_RESIDUAL_RATIO * np.median(usual)
        status[(status == Status.MEASURED) & too_far] = Status.NOT_RIGID


def least_information(weak: Float, tried: int) -> float:
    """From which information on its weakest direction, in standard errors, a window is held by its relief.

    Of hundreds of windows on a plane some stand above ``MIN_INFORMATION`` by chance. Where no more do than chance
    brings there, none is held: infinite.

    Args:
        weak: (k,) of the windows that have one; ``tried`` are all that were asked.
    """
    above = np.sort(weak[weak >= MIN_INFORMATION])[::-1]
    chance = tried * ndtr(-above)
    held = above[chance <= MAX_CHANCE_SHARE * np.arange(1, len(above) + 1)]
    if not len(held):
        return float("inf")
    return MIN_INFORMATION if held[-1] == above[-1] else float(held[-1])


def _largest_error(covariance: Float) -> Float:
    if not len(covariance):
        return np.zeros(0)
    return np.asarray(np.sqrt(np.maximum(np.linalg.eigvalsh(covariance)[:, -1], 0.0)))
