"""Where values lie on a chart: round numbers along an axis, and values to pixels."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

_STEPS = (1.0, 2.0, 2.5, 5.0, 10.0)


@dataclass(frozen=True)
class Axis:
    """Values from ``low`` to ``high`` lie on pixels from ``begin`` to ``end``, which may be the smaller one."""

    low: float
    high: float
    begin: float
    end: float

    def at(self, value: float) -> float:
        """The pixel of a value."""
        return self.begin + (value - self.low) / (self.high - self.low) * (self.end - self.begin)


def finite(values: Iterable[float]) -> list[float]:
    """Those that are numbers."""
    return [v for v in values if math.isfinite(v)]


def span(values: Iterable[float], margin: float = 0.06, smallest: float = 1e-3) -> tuple[float, float]:
    """Lowest and highest of the values that are numbers, with a margin; never narrower than ``smallest``."""
    known = finite(values) or [0.0]
    low, high = min(known), max(known)
    wider = max((high - low) * margin, (smallest - (high - low)) / 2, 0.0)
    return low - wider, high + wider


def ticks(low: float, high: float, most: int = 5) -> list[float]:
    """Round numbers within [low, high], about ``most`` of them."""
    if not high > low:
        return [low]
    rough = (high - low) / max(most, 1)
    power = 10.0 ** math.floor(math.log10(rough))
    step = next(s * power for s in _STEPS if s * power >= rough * (1 - 1e-9))
    first, last = math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9)
    return [number * step for number in range(first, last + 1)]


def label(value: float, step: float) -> str:
    """A number with the decimals that ticks ``step`` apart need."""
    decimals = next((d for d in range(9) if math.isclose(step * 10**d, round(step * 10**d), rel_tol=1e-6)), 9)
    text = f"{value:.{decimals}f}"
    return text[1:] if text.startswith("-") and not float(text) else text


def pieces(points: Sequence[tuple[float, ...]]) -> list[list[tuple[float, ...]]]:
    """The points cut where one is not known, so that no line is drawn over a gap."""
    found: list[list[tuple[float, ...]]] = [[]]
    for point in points:
        if all(math.isfinite(v) for v in point):
            found[-1].append(point)
        elif found[-1]:
            found.append([])
    return [piece for piece in found if piece]
