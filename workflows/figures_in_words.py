"""Figures of a run as words of a sentence: numbers with their units, and nothing where a figure is not known."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

Figures = Mapping[str, Any]


def sentence(text: str, *parts: str) -> str:
    """The sentence with its parts, empty where one is not known."""
    return text.format(*parts) if all(parts) else ""


def zones_found(count: int, what: str) -> str:
    """How many zones of what were found, as the beginning of a sentence."""
    return f"{number(count)} {plural(count, 'zone')} of {what} {'was' if count == 1 else 'were'} found"


def _known(figures: Figures, name: str) -> float | None:
    value = figures.get(name)
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not math.isfinite(value):
        return None
    return value


def number(value: float) -> str:
    """Three figures, whole numbers in full with commas."""
    if float(value).is_integer() or abs(value) >= 1000:
        return f"{round(value):,}"
    return f"{value:.3g}"


def counted(figures: Figures, name: str) -> str:
    """A count; empty where it is not known."""
    value = _known(figures, name)
    return "" if value is None else number(value)


def measured(figures: Figures, name: str, unit: str, *, error: str = "", sign: bool = True) -> str:
    """A figure with its unit and, where it is known, its standard error; empty where it is not known."""
    value = _known(figures, name)
    if value is None:
        return ""
    spread = _known(figures, error) if error else None
    value = value if sign else abs(value)
    # metres to the millimetre, which is finer than anything measured
    shown = f"{value:.3f}" if unit == "m" and 0.0005 <= abs(value) < 1000 else number(value)
    if spread is not None:
        shown = f"{shown} ± {number(float(f'{spread:.2g}'))}"
    return f"{shown} {unit}".rstrip()


def percent(figures: Figures, name: str) -> str:
    """A share as per cent to two figures; empty where it is not known."""
    value = _known(figures, name)
    return "" if value is None else f"{number(float(f'{100 * value:.2g}'))} %"


def plural(count: float, noun: str) -> str:
    """The noun, with an s unless there is one."""
    return noun if count == 1 else f"{noun}s"
