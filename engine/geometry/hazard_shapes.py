"""Forms of hazards: displacements of the ground square to the slope's mean plane, uplift positive, subsidence negative.

Each kind is a function of normalised coordinates: x across the dip and y up it, both within -1 to 1 over the hazard's
own extent, after its outline was made irregular. Simulated scenes and hazards put into real ground use the same forms.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ..core.arrays import Float, Float32
from ..core.errors import InputError


@dataclass(frozen=True)
class Hazard:
    """A displacement of the ground.

    ``u`` and ``w`` are its centre, ``half_u`` and ``half_w`` its half-axes (m) across and along the dip before it is
    turned by ``turn`` rad. ``height`` is its main displacement (m, signed), ``second`` that of its other part (the
    toe of a slump, the crack of a bulge). ``exponent`` is that of the super-ellipse of its outline, ``flatness`` and
    ``fall`` shape its profile (1 - r^flatness)^fall, ``skew`` moves the peak along the dip (towards the toe where
    positive). ``shift`` says where in the textures its irregularity is taken from.
    """

    kind: str
    u: float
    w: float
    half_u: float
    half_w: float
    height: float
    second: float = 0.0
    turn: float = 0.0
    exponent: float = 2.0
    flatness: float = 2.0
    fall: float = 1.5
    skew: float = 0.0
    wobble: float = 0.12
    shift: int = 0

    @property
    def bounds(self) -> tuple[float, float, float, float]:
        """u and w from, u and w to; nothing is displaced outside."""
        c, s = abs(math.cos(self.turn)), abs(math.sin(self.turn))
        reach = 1.6  # an outline may grow by a third
        du = reach * (self.half_u * c + self.half_w * s)
        dw = reach * (self.half_u * s + self.half_w * c)
        return self.u - du, self.w - dw, self.u + du, self.w + dw


def _superellipse(hazard: Hazard, x: Float32, y: Float32) -> Float32:
    """Profile from 1 at the peak to 0 on the outline."""
    if hazard.skew:
        y = y + np.float32(hazard.skew)  # the peak lies below the middle
        y = np.where(y > 0, y / np.float32(1 + hazard.skew), y / np.float32(1 - hazard.skew))
    p = np.float32(hazard.exponent)
    r = np.abs(x) ** p + np.abs(y) ** p
    return _power(np.maximum(1.0 - r ** np.float32(hazard.flatness / hazard.exponent), 0.0), hazard.fall)


def _power(base: Float32, exponent: float) -> Float32:
    """``base`` >= 0 to a power > 0. NumPy's own takes many times as long at 0, where most nodes of a window are."""
    inside = base > 0
    value = np.where(inside, base, np.float32(1.0)) ** np.float32(exponent)
    value *= inside
    return value


def _mound(hazard: Hazard, x: Float32, y: Float32, bumps: Float32) -> Float32:
    return np.float32(hazard.height) * _superellipse(hazard, x, y)


def _cracked_bulge(hazard: Hazard, x: Float32, y: Float32, bumps: Float32) -> Float32:
    """A bulge whose upper rim has torn open: a crack of about 0.1 m half-width along the upper half of the outline."""
    dz = _mound(hazard, x, y, bumps)
    r = np.sqrt(x * x + y * y)
    width = 0.10 / min(hazard.half_u, hazard.half_w)
    rim = np.exp(-(((r - np.float32(1.04) - 0.03 * bumps) / np.float32(width)) ** 2))
    return dz + np.float32(hazard.second) * rim * np.clip(3.0 * y, 0.0, 1.0)


def _slump(hazard: Hazard, x: Float32, y: Float32, bumps: Float32) -> Float32:
    """A scar below a curved scarp, deepest at its head, and the slumped mass as a lobe at the toe."""
    arch = y + np.float32(0.35) * x * x
    steep = np.float32(min(0.5, 0.3 / hazard.half_w))
    across = np.maximum(1.0 - np.abs(x) ** np.float32(hazard.exponent), 0.0)
    scar = np.clip((arch + 0.15) / 1.0, 0.0, 1.0) * np.clip((1.0 - arch) / steep, 0.0, 1.0) * np.sqrt(across)
    lobe = np.maximum(1.0 - ((y + 0.15 * x * x + 0.55) / 0.42) ** 2, 0.0) * np.maximum(1.0 - (x / 1.1) ** 2, 0.0)
    return np.float32(hazard.height) * scar + np.float32(hazard.second) * lobe * (1.0 + 0.2 * bumps)


def _scarp_and_bulge(hazard: Hazard, x: Float32, y: Float32, bumps: Float32) -> Float32:
    """A crescent that dropped along a scarp, and below it a broad bulge; intact ground may lie between."""
    arch = y + np.float32(0.45) * x * x
    steep = np.float32(min(0.4, 0.2 / hazard.half_w))
    across = np.sqrt(np.maximum(1.0 - np.abs(x) ** 3, 0.0))
    scarp = np.clip((arch - 0.35) / 0.45, 0.0, 1.0) * np.clip((1.0 - arch) / steep, 0.0, 1.0) * across
    bulge = _power(np.maximum(1.0 - (x / 1.05) ** 2 - ((y + 0.35) / 0.65) ** 2, 0.0), 0.8)
    return np.float32(hazard.height) * scarp + np.float32(hazard.second) * bulge * (1.0 + 0.15 * bumps)


def _trough(hazard: Hazard, x: Float32, y: Float32, bumps: Float32) -> Float32:
    """A long hollow whose depth changes along it and that ends within the slope, unlike a drain."""
    across = np.maximum(1.0 - np.abs(x + 0.08 * bumps) ** np.float32(hazard.flatness), 0.0)
    along = np.maximum(1.0 - y**4, 0.0)
    return np.float32(hazard.height) * across * along * np.clip(1.0 + 0.3 * bumps, 0.3, 1.7)


def _collapsed_cell(hazard: Hazard, x: Float32, y: Float32, bumps: Float32) -> Float32:
    """Soil that sank between the beams of a lattice: steep walls, a floor that tilts down the slope."""
    wall = np.float32(0.12 / min(hazard.half_u, hazard.half_w))
    inside = np.clip((1.0 - np.maximum(np.abs(x), np.abs(y))) / wall, 0.0, 1.0)
    floor = 0.75 + np.float32(0.25 * hazard.skew) * y + 0.15 * bumps
    return np.float32(hazard.height) * inside * np.clip(floor, 0.2, 1.2)


def _cone(hazard: Hazard, x: Float32, y: Float32, bumps: Float32) -> Float32:
    return np.float32(hazard.height) * np.maximum(1.0 - np.sqrt(x * x + y * y), 0.0)


def _blob(hazard: Hazard, x: Float32, y: Float32, bumps: Float32) -> Float32:
    """No outline of its own: where a random field is high, faded towards the edge."""
    fade = np.maximum(1.0 - (x * x + y * y), 0.0)
    return np.float32(hazard.height) * np.clip(0.55 + 0.45 * bumps, 0.0, 1.0) * np.sqrt(fade)


def _block(hazard: Hazard, x: Float32, y: Float32, bumps: Float32) -> Float32:
    """A rigid block with steep edges that moved out and tilted."""
    wall = np.float32(0.15 / min(hazard.half_u, hazard.half_w))
    inside = np.clip((1.0 - np.maximum(np.abs(x + 0.15 * y), np.abs(y))) / wall, 0.0, 1.0)
    return np.float32(hazard.height) * inside * (0.75 - np.float32(0.25) * y + np.float32(0.25 * hazard.skew) * x)


def _lobes(hazard: Hazard, x: Float32, y: Float32, bumps: Float32) -> Float32:
    """Creep: lobes with hollows between them, one below the other."""
    fade = np.sqrt(np.maximum(1.0 - np.abs(x) ** 3, 0.0)) * np.maximum(1.0 - y**4, 0.0)
    return np.float32(hazard.height) * np.sin(np.float32(2.5 * math.pi) * (y + 0.3 * x * x)) * fade


def _sinkhole(hazard: Hazard, x: Float32, y: Float32, bumps: Float32) -> Float32:
    wall = np.float32(min(0.6, 0.35 / min(hazard.half_u, hazard.half_w)))
    return np.float32(hazard.height) * np.clip((1.0 - np.sqrt(x * x + y * y)) / wall, 0.0, 1.0)


def _graben(hazard: Hazard, x: Float32, y: Float32, bumps: Float32) -> Float32:
    """A strip across the slope that dropped between two scarps, with a low ridge pushed up below it."""
    across = np.sqrt(np.maximum(1.0 - np.abs(x) ** 4, 0.0))
    wall = np.float32(min(0.4, 0.2 / hazard.half_w))
    drop = np.clip((1.0 - np.abs((y - 0.35) / 0.6)) * 0.6 / wall, 0.0, 1.0)
    ridge = np.maximum(1.0 - ((y + 0.65) / 0.35) ** 2, 0.0)
    return (np.float32(hazard.height) * drop + np.float32(hazard.second) * ridge) * across


SHAPES: dict[str, Callable[[Hazard, Float32, Float32, Float32], Float32]] = {
    "bulge": _mound,
    "toe_bulge": _mound,
    "cracked_bulge": _cracked_bulge,
    "bowl": _mound,
    "slump": _slump,
    "trough": _trough,
    "collapsed_cell": _collapsed_cell,
    "scarp_and_bulge": _scarp_and_bulge,
    "cone": _cone,
    "blob": _blob,
    "pit_blob": _blob,
    "block": _block,
    "lobes": _lobes,
    "sinkhole": _sinkhole,
    "graben": _graben,
}
RAISES = {"bulge", "toe_bulge", "cracked_bulge", "cone", "blob", "block", "lobes", "scarp_and_bulge"}
"""Kinds that add uplift; ``LOWERS`` those that add subsidence; some do both."""
LOWERS = {
    "bowl", "slump", "trough", "collapsed_cell", "scarp_and_bulge", "sinkhole", "graben", "pit_blob", "lobes",
}  # fmt: skip


def displacement_at(hazard: Hazard, u: Float, w: Float, *, folds: Float | None = None) -> Float:
    """Displacement (m) of a hazard at places of the flat frame: its height in the middle, 0 outside.

    Args:
        u: (n,) places across the dip, m. w: (n,) places up it, m.
        folds: (n,) a random texture of zero mean and unit scatter there, which makes the outline irregular by
            ``hazard.wobble``; smooth without it.
    """
    x, y = _normalised(hazard, u, w)
    bumps = np.zeros(1, dtype=np.float32)
    if folds is None:
        return SHAPES[hazard.kind](hazard, x.astype(np.float32), y.astype(np.float32), bumps).astype(np.float64)
    grow = 1.0 + hazard.wobble * np.clip(folds, -1.5, 2.0)
    x, y = x * grow, y * grow
    moved = SHAPES[hazard.kind](hazard, x.astype(np.float32), y.astype(np.float32), folds.astype(np.float32))
    return np.asarray(moved * np.clip(1.0 + 1.5 * hazard.wobble * folds, 0.5, 1.5), dtype=np.float64)


def outline(hazard: Hazard, corners: int = 72) -> Float:
    """(corners, 2) places of the flat frame on the hazard's super-ellipse."""
    angle = np.linspace(0.0, 2 * math.pi, corners, endpoint=False)
    c, s = np.cos(angle), np.sin(angle)
    power = 2.0 / hazard.exponent
    x = hazard.half_u * np.sign(c) * np.abs(c) ** power
    y = hazard.half_w * np.sign(s) * np.abs(s) ** power
    turn_c, turn_s = math.cos(hazard.turn), math.sin(hazard.turn)
    return np.column_stack([hazard.u + x * turn_c - y * turn_s, hazard.w + x * turn_s + y * turn_c])


def reach(hazard: Hazard) -> float:
    """Radius (m) of a circle about the hazard's middle that holds its super-ellipse."""
    return float(max(hazard.half_u, hazard.half_w)) * 2.0 ** max(0.0, 0.5 - 1.0 / hazard.exponent)


def _normalised(hazard: Hazard, u: Float, w: Float) -> tuple[Float, Float]:
    c, s = math.cos(hazard.turn), math.sin(hazard.turn)
    du, dw = u - hazard.u, w - hazard.w
    return (du * c + dw * s) / hazard.half_u, (dw * c - du * s) / hazard.half_w


def smooth_hazard(
    height: float,
    diameter: float,
    rng: np.random.Generator,
    *,
    elongations: tuple[float, float] = (0.75, 1 / 0.75),
) -> Hazard:
    """A bulge, or a bowl where ``height`` (m) is negative, of ``diameter`` m with its peak in its middle, a little
    longer than wide, in any direction: the forms of hazards of known place in ``simulation``.

    Args:
        elongations: range of the ratio of its axes, whose product stays.

    Raises:
        InputError: height or diameter is none.
    """
    if not (math.isfinite(height) and height != 0 and math.isfinite(diameter) and diameter > 0):
        raise InputError(
            f"A hazard of {height} m height and {diameter} m diameter cannot be put in; give a height other than 0 "
            "and a diameter above 0."
        )
    stretch = math.sqrt(math.exp(rng.uniform(math.log(elongations[0]), math.log(elongations[1]))))
    return Hazard(
        "bulge" if height > 0 else "bowl",
        0.0,
        0.0,
        diameter / 2 * stretch,
        diameter / 2 / stretch,
        height,
        turn=rng.uniform(-math.pi / 2, math.pi / 2),
        exponent=rng.uniform(1.8, 3.0),
        flatness=rng.uniform(2.0, 4.0),
        fall=rng.uniform(1.0, 1.5),
        wobble=0.0,
    )
