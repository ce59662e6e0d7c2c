"""What an object is, by its shape and by whether pulses went through it."""

from __future__ import annotations

import math

from .candidates import MIN_HEIGHT_M
from .evidence import FLAT_TOP
from .find import Found

BOULDER, WALL, HEAP, UNKNOWN, VEGETATION = "boulder", "wall", "vehicle or heap", "unknown", "vegetation"
KINDS = (BOULDER, WALL, HEAP, UNKNOWN, VEGETATION)
DEPOSITS = (BOULDER, HEAP)
"""Kinds that are deposits if they appeared; a vehicle is to be told from a heap by eye."""
MIN_NAMED_THROUGH, MANY_THROUGH, MIN_NAMED_SEEN = 3, 8, 0.3
"""How well the other survey saw a place whose object is named: returns on the ground below, and the share of the
footprint that they reach unless they are many."""
MAX_MISFIT, MIN_FILLED = 0.2, 0.4
"""Scatter about a smooth surface as a share of the height, and share of the smallest rectangle that is filled.

Returns spread evenly over the height have a scatter of 0.29, and a triangle fills half of its rectangle."""
MIN_SIDES = math.tan(math.radians(20.0))
"""Least inclination of an object's sides in the mean: a footprint has a rim, and a few returns miss its top."""
MIN_NAMED_LENGTH_M = 0.8
_WALL_LENGTHS, _MAX_WALL_WIDTH_M, _MIN_WALL_LENGTH_M = 3.0, 2.0, 2.0
_BOULDER_LENGTHS, _MAX_BOULDER_WIDTH_M, _SMALL_M, _BOULDER_HEIGHTS = 2.0, 3.0, 1.5, (0.3, 1.2)
_MIN_FLAT_RETURNS = 6
_MAX_HEAP_LENGTH_M = 15.0


def standing(found: Found) -> bool:
    """Whether it stands out of the ground, rather than being ground that rose or sank, such as a slide's toe.

    A cone has the inclination of its sides in the mean at whatever height it is cut; heaps have 30° and more.
    """
    height, reach = found.shape.height - MIN_HEIGHT_M, math.sqrt(found.area.area / math.pi)
    return height > MIN_SIDES * reach and found.shape.height - max(found.pit, 0.0) > MIN_HEIGHT_M


def kind_of(found: Found) -> tuple[str, str]:
    """The kind, and the reason in words."""
    shape = found.shape
    if not found.closed:
        returns = found.owner.hits + found.owner.through
        through = f"{found.owner.through} of {returns} returns lie below its crown"
        return VEGETATION, f"{through}, {found.ended:.0%} of the others are the last of their pulse"
    enough = MIN_NAMED_THROUGH if found.seen >= MIN_NAMED_SEEN else MANY_THROUGH
    if found.other.through < enough:
        return UNKNOWN, f"the other survey has only {found.other.through} returns from the ground below it"
    kind = _by_shape(found)
    if kind == UNKNOWN:
        return kind, "closed surface of no known shape"
    return kind, f"closed surface, {shape.length / max(shape.width, 0.01):.1f} times as long as wide"


def _by_shape(found: Found) -> str:
    shape = found.shape
    ragged = not math.isnan(shape.misfit) and shape.misfit > MAX_MISFIT * shape.height
    if ragged or shape.length < MIN_NAMED_LENGTH_M:
        return UNKNOWN
    if shape.length >= max(_WALL_LENGTHS * shape.width, _MIN_WALL_LENGTH_M) and shape.width <= _MAX_WALL_WIDTH_M:
        return WALL
    if found.area.area < MIN_FILLED * shape.length * shape.width:
        return UNKNOWN
    low, high = (share * max(shape.width, shape.length / 2) for share in _BOULDER_HEIGHTS)
    if shape.height > high:
        return UNKNOWN
    compact = shape.width <= _MAX_BOULDER_WIDTH_M and (
        shape.length <= _BOULDER_LENGTHS * shape.width or shape.length <= _SMALL_M
    )
    flat = shape.lowest >= FLAT_TOP * shape.height and len(found.returns) >= _MIN_FLAT_RETURNS
    if compact and not flat and shape.height >= low:
        return BOULDER
    return HEAP if shape.length <= _MAX_HEAP_LENGTH_M else UNKNOWN
