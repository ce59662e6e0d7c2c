"""Where on a cut slope ground moves along itself, and how large the moving parts are."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from ...engine.core.arrays import Float
from .gliding import Glide, Turn
from .moved_ground import SurfaceMotion
from .plane import FacePlane
from .slump import RotationalSlump

KINDS = ("translation", "rotation", "creep", "slump")
MAX_HALF_ACROSS_M = 4.0
_ELONGATION = 1.5
"""Of a moving part: its length along the dip by its width."""
_CORE_EDGE = 0.25
_DEPTH_SHARE = 0.25
"""Depth of a slump by half its length: slip surfaces of rotational slides are 0.15 to 0.33 of the length deep."""


def motions_on(
    face: tuple[Float, Float], slope: tuple[float, float, float, float], kinds: Sequence[str], amount: float
) -> tuple[SurfaceMotion, ...]:
    """One motion for each of ``kinds``, side by side along the slope, in the middle of its longest face.

    Args:
        face: v and z of the slope's profile, v rising.
        slope: u and v from, u and v to of the slope.
        amount: way of the middle (rotation: at the end of the core), m.

    Raises:
        TooFarError: the amount is too large for a soft edge.
        ValueError: a kind is unknown.
    """
    low, high, height, gradient = _longest_face(*face, slope)
    dip = math.degrees(math.atan(gradient))
    length = (high - low) * math.hypot(1.0, gradient)
    room = (slope[2] - slope[0]) / max(len(kinds), 1)
    half_across = min(MAX_HALF_ACROSS_M, 0.4 * room, 0.42 * length / _ELONGATION)
    half_along = _ELONGATION * half_across
    found: list[SurfaceMotion] = []
    for number, kind in enumerate(kinds):
        plane = FacePlane(slope[0] + room * (number + 0.5), (low + high) / 2, height, dip)
        if kind == "translation":
            found.append(Glide(plane, half_across, half_along, amount, _CORE_EDGE))
        elif kind == "creep":
            found.append(Glide(plane, half_across, half_along, amount))
        elif kind == "rotation":
            found.append(Turn(plane, half_across, amount))
        elif kind == "slump":
            found.append(RotationalSlump(plane, half_across, half_along, _DEPTH_SHARE * half_along, amount))
        else:
            raise ValueError(f"kind is {kind!r}; give one of {', '.join(KINDS)}")
    return tuple(found)


def _longest_face(v: Float, z: Float, slope: tuple[float, float, float, float]) -> tuple[float, float, float, float]:
    """v from and to, height of the middle and gradient of the longest even part of the slope that is no berm."""
    inside = (v[:-1] >= slope[1] - 1e-6) & (v[1:] <= slope[3] + 1e-6)
    gradient = np.diff(z) / np.diff(v)
    length = np.where(inside & (gradient > 0.5 * gradient[inside].max()), np.diff(v), 0.0)
    # The lowest but one of several alike lies away from the road.
    alike = np.flatnonzero(length > 0.99 * length.max())
    part = int(alike[len(alike) // 2])
    return float(v[part]), float(v[part + 1]), float((z[part] + z[part + 1]) / 2), float(gradient[part])
