"""Colours: a diverging and a sequential ramp and greys (probabilities) for the styles, the heatmap and the report.

Lowering is red, raising is blue, as geomorphologists draw erosion and deposition. The two arms have the same lightness
at the same magnitude (built in OKLCH, https://bottosson.github.io/posts/oklab), and stay apart in simulated red-green
colour blindness (Machado et al. 2009, doi:10.1109/TVCG.2009.113): 0.13 or more in OKLab beyond a quarter of the range.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...interface.seen import COMPARED, EXCLUDED, NOT_IN_BOTH, NOT_IN_FIRST, NOT_IN_LATER, OUTSIDE, TOO_FEW

Colour = tuple[int, int, int]

# Share of the range, colour of lowering, colour of raising.
DIVERGING: tuple[tuple[float, Colour, Colour], ...] = (
    (0.0, (0xF5, 0xF5, 0xF5), (0xF5, 0xF5, 0xF5)),
    (0.1, (0xF8, 0xD7, 0xBE), (0xC9, 0xE2, 0xF2)),
    (0.25, (0xF2, 0xAB, 0x83), (0x90, 0xC5, 0xE9)),
    (0.45, (0xE0, 0x6B, 0x46), (0x4F, 0x99, 0xD4)),
    (0.7, (0xB4, 0x36, 0x28), (0x2A, 0x6B, 0xAE)),
    (1.0, (0x77, 0x1D, 0x18), (0x1D, 0x41, 0x76)),
)
SEQUENTIAL: tuple[tuple[float, Colour], ...] = (
    (0.0, (0xF7, 0xF4, 0xE9)),
    (0.25, (0xD9, 0xD2, 0xA8)),
    (0.5, (0xA7, 0xAE, 0x7C)),
    (0.75, (0x62, 0x82, 0x6C)),
    (1.0, (0x21, 0x4E, 0x5A)),
)
LIKELIHOOD: tuple[tuple[float, Colour], ...] = (
    (0.0, (0xEC, 0xEC, 0xEC)),
    (0.25, (0xD4, 0xD4, 0xD4)),
    (0.5, (0xB2, 0xB2, 0xB2)),
    (0.75, (0x88, 0x88, 0x88)),
    (1.0, (0x5E, 0x5E, 0x5E)),
)
SEEN: dict[int, tuple[int, int, int, int]] = {
    OUTSIDE: (255, 255, 255, 0),
    COMPARED: (255, 255, 255, 0),
    NOT_IN_FIRST: (0xE3, 0xB5, 0x05, 150),
    NOT_IN_LATER: (0xB8, 0x86, 0x0B, 190),
    NOT_IN_BOTH: (0x5C, 0x43, 0x1A, 190),
    TOO_FEW: (0xE8, 0xDC, 0xA8, 150),
    EXCLUDED: (0x20, 0x20, 0x20, 190),
}
"""Of the classes of what was seen: ochre, which is no colour of a change; what was compared is left to the change."""
UNSEEN_FILL, UNSEEN_STRIPE = (0xE3, 0xB5, 0x05, 70), (0x5C, 0x43, 0x1A, 220)
"""Red, green, blue and opacity of the hatching over all that was not seen."""
BELOW_LEVEL: Colour = (0x8C, 0x8C, 0x8C)
SLIDING_TINTS: tuple[Colour, ...] = (
    (0x6A, 0x3D, 0x9A), (0x8C, 0x68, 0xB5), (0xAE, 0x94, 0xCF), (0xC9, 0xB8, 0xDF),
)  # fmt: skip
"""Of ground that slid, from the highest grade on: violet, which is no colour of lowering or raising."""
SLIDING_LINE: Colour = (0x3F, 0x1F, 0x66)


_SIGNED = (
    *((-share, lowered) for share, lowered, _ in DIVERGING[:0:-1]),
    *((share, raised) for share, _, raised in DIVERGING),
)


def colours_at(ramp: Sequence[tuple[float, Colour]], places: NDArray[np.floating]) -> NDArray[np.uint8]:
    """RGB (..., 3) of ``places`` (...) on a ramp, between its stops."""
    stops, colours = zip(*ramp, strict=True)
    bands = [np.interp(places, stops, band) for band in zip(*colours, strict=True)]
    return np.rint(np.stack(bands, axis=-1)).astype(np.uint8)


def signed_colours(share: float) -> tuple[Colour, Colour]:
    """Colours of lowering and of raising by ``share`` (0 to 1) of the diverging ramp's range."""
    (r, g, b), (red, green, blue) = colours_at(_SIGNED, np.array([-share, share])).tolist()
    return (r, g, b), (red, green, blue)


def diverging_colours(values: NDArray[np.floating], limit: float) -> NDArray[np.uint8]:
    """RGB (..., 3) of ``values`` in metres on the ramp from -limit to +limit, clipped to it; NaN is black."""
    index = np.nan_to_num(np.rint((np.clip(values, -limit, limit) / limit + 1.0) * 510.0)).astype(np.int64)
    rgb = colours_at(_SIGNED, np.linspace(-1, 1, 1021))[index]
    rgb[np.isnan(values)] = 0
    return rgb


def sequential_steps(count: int) -> list[Colour]:
    """``count`` colours along the sequential ramp, lightest first."""
    return [(red, green, blue) for red, green, blue in colours_at(SEQUENTIAL, np.linspace(0, 1, count)).tolist()]


def colour_limit(values: NDArray[np.floating], colour_range: float | None = None, *, level: float = 0.0) -> float:
    """End of a legend in metres: ``colour_range`` where it is given, else the rounded 98th percentile of magnitudes.

    Never below twice the ``level`` of detection, so that noise is not drawn in full colours.
    """
    if colour_range:
        return colour_range
    known = np.abs(values[np.isfinite(values)])
    largest = float(np.percentile(known, 98)) if known.size else 0.0
    return rounded_up(max(largest, 2.0 * level if math.isfinite(level) else 0.0, 0.01))


def rounded_up(value: float) -> float:
    """The next of 1, 1.5, 2, 3, 4, 5, 6, 8 times a power of ten that is not below ``value`` (> 0)."""
    power = 10.0 ** math.floor(math.log10(value))
    for step in (1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0):
        if step * power >= value * (1 - 1e-9):
            return float(f"{step * power:.6g}")
    raise AssertionError(value)


def veiled(lightness: NDArray[np.float32] | float, opacity: float) -> Any:
    """Lightness (0 to 255) under the grey veil of cells below the level, which is fainter than the change's opacity."""
    return lightness + 0.4 * opacity * (BELOW_LEVEL[0] - lightness)


def hexadecimal(colour: Colour) -> str:
    """``#rrggbb``."""
    return "#{:02x}{:02x}{:02x}".format(*colour)
