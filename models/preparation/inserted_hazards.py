"""Hazards put into ground points in the flat frame, and what else changes a survey of the same ground.

Training calls this at each step and the benchmark for each trial, so that relief is real or simulated, hazards are
known exactly, and no two looks at a slope are the same. The forms are those of simulated scenes
(``geometry.hazard_shapes``); places lie on ground that has points.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_erosion, distance_transform_edt, gaussian_filter, map_coordinates

from ...engine.core.arrays import Bool, Float, Index
from ...engine.core.errors import InputError
from ...engine.geometry.hazard_shapes import Hazard, displacement_at, reach

BACKGROUND, UPLIFT, SUBSIDENCE = 0, 1, 2
LABEL_LIMIT_M = 0.03
"""Displacement beyond which a point is labelled, or a tenth of the hazard's height where that is more."""
NODE_M = 0.5
"""Side of the cells on which places are tried."""
SEPARATION_M = 1.0
VARIED = {
    "bulge": 3.0, "toe_bulge": 1.5, "cracked_bulge": 1.2, "bowl": 2.5, "slump": 1.5, "trough": 1.0,
    "scarp_and_bulge": 1.3, "cone": 0.7, "block": 0.7, "sinkhole": 0.6,
}  # fmt: skip
"""Weights of the kinds of ``varied_hazard``."""
_RAISES = {"bulge", "toe_bulge", "cracked_bulge", "cone", "block", "scarp_and_bulge"}
_LOWERS = {"bowl", "slump", "trough", "sinkhole", "scarp_and_bulge"}
_ELONGATIONS = (0.6, 1.7)
_LONG = {"slump", "trough", "scarp_and_bulge"}
_FOLD_WAVES = 12
_DENSITY_SQUARE_M = 4.0


@dataclass(frozen=True)
class Placed:
    """A hazard in the ground: which of those wanted it is, its form in the flat frame, nominal diameter (m), and
    whether it lifts or lowers the ground as a whole.
    """

    number: int
    shape: Hazard
    diameter: float
    label: int


@dataclass(frozen=True)
class Inserted:
    """Ground with hazards in it.

    ``flat`` (n, 3) m in the flat frame, in the order of the input; per point ``label`` (0 background, 1 uplift, 2
    subsidence), ``hazard`` (its number, -1 where there is none) and ``displacement`` (m, square to the slope).
    ``hazards`` are those that found a place.
    """

    flat: Float
    label: NDArray[np.uint8]
    hazard: NDArray[np.int32]
    displacement: Float
    hazards: tuple[Placed, ...]


class Room:
    """Where on the ground hazards may lie.

    Args:
        xy: (n, 2) points in the flat frame, m.
        minimum_density: that a place and its surroundings need, points/m²; half of the median by default.
    """

    def __init__(self, xy: Float, minimum_density: float | None = None) -> None:
        self.low = xy.min(axis=0) - NODE_M
        cell = np.floor((xy - self.low) / NODE_M).astype(np.int64)
        shape = tuple(int(n) + 2 for n in cell.max(axis=0))
        count = np.bincount(cell[:, 0] * shape[1] + cell[:, 1], minlength=shape[0] * shape[1]).reshape(shape)
        # A Gaussian over about six points levels out the lattice of elevation models and scan lines.
        sigma = max(1.0, math.sqrt(6.0 / (4 * math.pi * ground_density(xy))) / NODE_M)
        density = gaussian_filter(count.astype(np.float64), sigma, mode="constant") / NODE_M**2
        usual = float(np.median(density[count > 0]))
        least = 0.5 * usual if minimum_density is None else minimum_density
        self.rooms = distance_transform_edt(density >= least) * NODE_M

    def free(self, radius: float) -> Bool:
        """(nodes, nodes) places about which a circle of ``radius`` m lies on ground that is not taken."""
        return np.asarray(self.rooms > radius, dtype=np.bool_)

    def keep_off(self, places: Float) -> None:
        """Leave no room for a circle that any of ``places`` (n, 2), m, lies in."""
        if not len(places):
            return
        node = np.floor((places - self.low) / NODE_M).astype(np.int64)
        node = node[((node >= 0) & (node < self.rooms.shape)).all(axis=1)]
        far = np.ones(self.rooms.shape, dtype=bool)
        far[node[:, 0], node[:, 1]] = False
        # Places and middles of circles lie anywhere in their nodes: those next to a place's node are as near.
        far = binary_erosion(far, np.ones((3, 3), dtype=bool), border_value=1)
        if not far.all():
            np.minimum(self.rooms, distance_transform_edt(far) * NODE_M, out=self.rooms)

    def take(self, radius: float, rng: np.random.Generator, separation: float) -> tuple[float, float] | None:
        """A random place for a circle of ``radius`` m, which is taken then; None where there is no room."""
        choices = np.flatnonzero(self.free(radius).ravel())
        if not len(choices):
            return None
        i, j = divmod(int(choices[rng.integers(len(choices))]), self.rooms.shape[1])
        u, w = self.low + (np.array([i, j]) + rng.uniform(0.0, 1.0, 2)) * NODE_M
        far = np.hypot(*(np.ogrid[: self.rooms.shape[0], : self.rooms.shape[1]][k] - (i, j)[k] for k in (0, 1)))
        np.minimum(self.rooms, far * NODE_M - radius - separation, out=self.rooms)
        return float(u), float(w)


def insert_hazards(
    flat: Float,
    wanted: Sequence[Hazard],
    rng: np.random.Generator,
    *,
    separation: float = SEPARATION_M,
    minimum_density: float | None = None,
) -> Inserted:
    """Displace points square to the slope by hazards at random places at least ``separation`` m apart.

    A hazard for which there is no room is left out. The same generator state gives the same result.

    Args:
        flat: (n, 3) ground points in the slope's flat frame, m.
        wanted: forms, wherever they lie (``smooth_hazard``, ``varied_hazard``).
        minimum_density: points/m² that the ground under a hazard must have; half of the median by default.

    Raises:
        InputError: there is no point.
    """
    if not len(flat):
        raise InputError("There is no ground point to put hazards into; check the cloud.")
    room = Room(flat[:, :2], minimum_density)
    displacement = np.zeros(len(flat))
    identity = np.full(len(flat), -1, dtype=np.int32)
    label = np.zeros(len(flat), dtype=np.uint8)
    placed: list[Placed] = []
    # Large ones first: they find no room later.
    for number in sorted(range(len(wanted)), key=lambda k: -outer_radius(wanted[k])):
        place = room.take(outer_radius(wanted[number]), rng, separation)
        if place is None:
            continue
        hazard = replace(wanted[number], u=place[0], w=place[1])
        u0, w0, u1, w1 = hazard.bounds
        near = np.flatnonzero(
            (flat[:, 0] > u0) & (flat[:, 0] < u1) & (flat[:, 1] > w0) & (flat[:, 1] < w1) & (identity < 0)
        )
        u, w = flat[near, 0], flat[near, 1]
        moved = displacement_at(hazard, u, w, folds=_folds(hazard, u, w) if hazard.wobble else None)
        limit = label_limit(hazard)
        displacement[near] += moved
        identity[near[moved != 0]] = number
        label[near] = np.where(moved > limit, UPLIFT, np.where(moved < -limit, SUBSIDENCE, label[near]))
        whole = moved.sum() if moved.any() else hazard.height
        diameter = 2 * math.sqrt(hazard.half_u * hazard.half_w)
        placed.append(Placed(number, hazard, diameter, UPLIFT if whole > 0 else SUBSIDENCE))
    result = flat.copy()
    result[:, 2] += displacement
    placed.sort(key=lambda one: one.number)
    return Inserted(result, label, identity, displacement, tuple(placed))


def varied_hazard(
    height: float, diameter: float, rng: np.random.Generator, *, elongations: tuple[float, float] = _ELONGATIONS
) -> Hazard:
    """One of the kinds of simulated scenes with an irregular outline: bulges, cracked ones, bowls, slumps with the mass
    at their toe, troughs, scarps above bulges, blocks. ``height`` (m, signed) is that of the main part, ``elongations``
    the range of the width across the dip over the length along it; kinds that are long by themselves have their own.
    """
    fitting = _RAISES if height > 0 else _LOWERS
    kinds = [kind for kind in VARIED if kind in fitting]
    weights = np.array([VARIED[kind] for kind in kinds])
    kind = str(rng.choice(kinds, p=weights / weights.sum()))
    limits = _ELONGATIONS if kind in _LONG else elongations
    stretch = math.sqrt(math.exp(rng.uniform(math.log(limits[0]), math.log(limits[1]))))
    base = Hazard(
        kind,
        0.0,
        0.0,
        diameter / 2 * stretch,
        diameter / 2 / stretch,
        height,
        exponent=rng.uniform(1.8, 4.0),
        flatness=rng.uniform(1.5, 5.0),
        fall=rng.uniform(0.8, 2.0),
        skew=rng.uniform(-0.3, 0.5),
        turn=rng.uniform(-0.4, 0.4),
        wobble=rng.uniform(0.05, 0.18),
        shift=int(rng.integers(0, 2**31)),
    )
    if kind == "toe_bulge":
        return replace(base, skew=rng.uniform(0.5, 0.75), flatness=rng.uniform(2.5, 5.0), fall=rng.uniform(0.6, 1.0))
    if kind == "cracked_bulge":
        return replace(base, second=-rng.uniform(0.08, 0.25) if diameter > 2.0 else -0.06, exponent=2.0, skew=0.0)
    if kind == "slump":
        long = base.half_w * rng.uniform(1.1, 1.6)
        return replace(base, half_w=long, second=-height * rng.uniform(0.3, 0.8), exponent=rng.uniform(2.0, 4.0))
    if kind == "trough":
        return replace(base, half_u=base.half_u * rng.uniform(0.35, 0.6), turn=rng.uniform(-math.pi / 2, math.pi / 2))
    if kind == "scarp_and_bulge":
        # Its main part is the scarp, or the bulge where that is what rises.
        other = height * rng.uniform(0.4, 1.2)
        scarp, bulge = (-other, height) if height > 0 else (height, -other)
        return replace(base, half_w=base.half_w * rng.uniform(1.1, 1.5), height=scarp, second=bulge)
    return base


def thinned(flat: Float, density: float, rng: np.random.Generator) -> NDArray[np.intp]:
    """Numbers, rising, of a random choice of points (n, 2 or 3) with about ``density`` points/m² of covered ground; all
    where there are not more.
    """
    cell = np.floor(flat[:, :2]).astype(np.int64)
    cell -= cell.min(axis=0)
    counts = np.bincount(cell[:, 0] * (cell[:, 1].max() + 1) + cell[:, 1])
    usual = float(np.median(counts[counts > 0]))
    if density >= usual:
        return np.arange(len(flat))
    return np.flatnonzero(rng.uniform(0.0, 1.0, len(flat)) < density / usual)


def mirrored(inserted: Inserted) -> Inserted:
    """Heights upside down: bulges are hollows then, and the classes change places."""
    flat = inserted.flat * [1.0, 1.0, -1.0]
    label = np.array([BACKGROUND, SUBSIDENCE, UPLIFT], dtype=np.uint8)[inserted.label]
    hazards = tuple(
        replace(
            one,
            shape=replace(one.shape, height=-one.shape.height, second=-one.shape.second),
            label=SUBSIDENCE if one.label == UPLIFT else UPLIFT,
        )
        for one in inserted.hazards
    )
    return Inserted(flat, label, inserted.hazard, -inserted.displacement, hazards)


def strip_offset(flat: Float, offset: float, rng: np.random.Generator, overlap: float = 10.0) -> Float:
    """Points (n, 3) as of two strips, one of which lies ``offset`` m higher square to the slope.

    The strips meet along a line in any direction through the middle half of the ground; in a band of ``overlap`` m
    about it points belong to either at random.
    """
    angle = rng.uniform(0.0, math.pi)
    across = flat[:, 0] * math.cos(angle) + flat[:, 1] * math.sin(angle)
    line = np.quantile(across, rng.uniform(0.25, 0.75))
    second = across + rng.uniform(-overlap / 2, overlap / 2, len(flat)) > line
    result = flat.copy()
    result[:, 2] += offset * second
    return result


def displacement_on_cells(
    hazard: Hazard, origin: Float, cell: float, shape: tuple[int, int]
) -> tuple[Index, Index, Float]:
    """Columns, rows and displacement (n,) m of the cells' middles within the bounds of a hazard, on a raster of
    ``shape`` cells of ``cell`` m from ``origin`` (2,) on.
    """
    u0, w0, u1, w1 = hazard.bounds
    low = np.maximum(np.floor((np.array([u0, w0]) - origin) / cell), 0).astype(int)
    high = np.minimum(np.ceil((np.array([u1, w1]) - origin) / cell), shape).astype(int)
    i, j = (part.ravel() for part in np.meshgrid(*(np.arange(a, b) for a, b in zip(low, high)), indexing="ij"))
    if not len(i):
        return i, j, np.zeros(0)
    u, w = origin[0] + (i + 0.5) * cell, origin[1] + (j + 0.5) * cell
    return i, j, displacement_at(hazard, u, w, folds=_folds(hazard, u, w) if hazard.wobble else None)


def label_limit(hazard: Hazard) -> float:
    """Displacement (m) beyond which ground belongs to a hazard."""
    return max(LABEL_LIMIT_M, 0.1 * abs(hazard.height))


def footprint(hazard: Hazard, origin: Float, cell: float, shape: tuple[int, int]) -> tuple[Bool, Bool]:
    """Cells (columns, rows) of a raster from ``origin`` (2,) on in which a hazard lifts the ground beyond the limit of
    labels, and those in which it lowers it.
    """
    up, down = np.zeros(shape, dtype=bool), np.zeros(shape, dtype=bool)
    i, j, moved = displacement_on_cells(hazard, origin, cell, shape)
    limit = label_limit(hazard)
    up[i, j], down[i, j] = moved > limit, moved < -limit
    return up, down


def ground_density(xy: Float) -> float:
    """Points/m² of the median occupied square of ``_DENSITY_SQUARE_M``."""
    square = np.floor((xy - xy.min(axis=0)) / _DENSITY_SQUARE_M).astype(np.int64)
    counts = np.bincount(square[:, 0] * (square[:, 1].max() + 1) + square[:, 1])
    return float(np.median(counts[counts > 0])) / _DENSITY_SQUARE_M**2


def outer_radius(hazard: Hazard) -> float:
    """Radius (m) of a circle about the hazard's middle that holds its irregular outline."""
    return reach(hazard) * (1.2 if hazard.wobble else 1.0)


def _folds(hazard: Hazard, u: Float, w: Float) -> Float:
    """A random texture (n,) of zero mean and unit scatter, the same for the same hazard: waves of a quarter to one and
    a half of its width in any direction, interpolated from a raster of its own.
    """
    rng = np.random.default_rng(hazard.shift)
    size = 2 * math.sqrt(hazard.half_u * hazard.half_w)
    length = size * np.exp(rng.uniform(math.log(0.25), math.log(1.5), _FOLD_WAVES))
    angle, phase = rng.uniform(0, 2 * math.pi, (2, _FOLD_WAVES))
    share = length / size
    share = share / math.sqrt(float((share**2).sum()) / 2)
    u0, w0, u1, w1 = hazard.bounds
    step = size / 20
    x, y = np.arange(u0, u1 + 2 * step, step), np.arange(w0, w1 + 2 * step, step)
    phases = 2 * math.pi / length * np.cos(angle), 2 * math.pi / length * np.sin(angle)
    along = np.exp(1j * (np.outer(x - hazard.u, phases[0]) + phase))
    texture = ((along * share) @ np.exp(1j * np.outer(y - hazard.w, phases[1])).T).real
    return np.asarray(map_coordinates(texture, [(u - u0) / step, (w - w0) / step], order=1, mode="nearest"))
