"""Shapes whose lines cross so often that GEOS would take hours and gigabytes: they are refused first."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from ..core.arrays import Bool, Float
from ..core.errors import InputError

MAX_REPAIRED_CROSSINGS = 2_000
"""Of an outline with itself: 3,000 take ``make_valid`` 3 s, 9,000 20 s, 42,000 240 s (GEOS 3.11, one core)."""
MAX_CROSSINGS = 20_000
"""Of all outlines of a file: their union takes 1 s."""
_MAX_PAIRS, _MAX_PAIRS_PER_SEGMENT = 5_000_000, 12
"""Of segments whose boxes meet: in all, and more for large files. An outline has about five for each of its corners."""
_PAIRS_AT_ONCE = 1_000_000


def refuse_tangled(shapes: Any, subject: str) -> None:
    """Raise InputError for shapes whose segments cross too often; to be called before they are repaired or united.

    Args:
        shapes: geometries, None among them; the invalid ones will be repaired.
        subject: names them in the sentence.
    """
    known = [shape for shape in shapes if shape is not None and not shape.is_empty]
    sentence = f"{subject} crosses itself too often; draw simple outlines, or give fewer of them."
    if _crossings(_segments(known), MAX_CROSSINGS) > MAX_CROSSINGS:
        raise InputError(sentence)
    invalid = [shape for shape in known if not shape.is_valid]
    if invalid and _crossings(_segments(invalid), MAX_REPAIRED_CROSSINGS) > MAX_REPAIRED_CROSSINGS:
        raise InputError(sentence)


def _segments(shapes: list[Any]) -> Float:
    """Ends (n, 2, 2) of each straight piece of all outlines."""
    rings = shapely.get_parts(shapely.get_rings(shapely.get_parts(shapely.get_parts(shapes))))
    xy, owner = shapely.get_coordinates(rings, return_index=True)
    together = owner[1:] == owner[:-1]
    return np.stack([xy[:-1][together], xy[1:][together]], axis=1)


def _crossings(segments: Float, enough: int) -> int:
    """How many pairs of segments cross within both; stops beyond ``enough``, which too many to look at are, too."""
    found = pairs = 0
    most = _MAX_PAIRS + _MAX_PAIRS_PER_SEGMENT * len(segments)
    for first, second in _near(segments):
        pairs += len(first)
        later = first < second
        a, b = segments[first[later]], segments[second[later]]
        found += int((_on_both_sides(a, b) & _on_both_sides(b, a)).sum())
        if pairs > most or found > enough:
            return enough + 1
    return found


def _on_both_sides(lines: Float, segments: Float) -> Bool:
    """Whether the ends of each segment (n, 2, 2) lie on two sides of the line through the other's."""
    along = (lines[:, 1] - lines[:, 0])[:, None, :]
    to_ends = segments - lines[:, :1]
    side = along[..., 0] * to_ends[..., 1] - along[..., 1] * to_ends[..., 0]
    return np.asarray(side[:, 0] * side[:, 1] < 0)


def _near(segments: Float) -> Iterator[NDArray[np.int64]]:
    """Pairs of segments whose boxes meet, (2, k) some at a time."""
    boxes = shapely.linestrings(segments)
    tree = shapely.STRtree(boxes)
    step = max(1, _PAIRS_AT_ONCE // max(1, len(segments)))
    start = 0
    while start < len(segments):
        pairs = tree.query(boxes[start : start + step])
        pairs[0] += start
        yield pairs
        start += step
        step = min(4 * step, max(1, step * _PAIRS_AT_ONCE // max(1, pairs.shape[1])))  # most outlines have few
