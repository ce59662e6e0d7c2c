"""Patches of ground with hazards put in anew each time, for the network that reads rasters.

A patch is cut out of a piece of ground at a random place, laid flat, turned, mirrored, stretched or shrunk, thinned and
made noisy, then averaged on cells; hazards are added to the heights of the cells. That equals adding them to the points
up to the curvature within a cell. Natural relief looks alike at many scales: an elevation model of 1 m shrunk to a
quarter is ground of 16 points/m² with real gullies and ridges, if smaller ones.

Ground may come with labels. Its own hazards stay what they are, and others are put in where it is background only.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ...engine.core.arrays import Float, Float32, Index
from ...engine.core.errors import InputError
from ...engine.geometry.hazard_shapes import Hazard, smooth_hazard
from ..preparation.bump_filter import CellHeights, cell_heights
from ..preparation.inserted_hazards import (
    BACKGROUND,
    SUBSIDENCE,
    UPLIFT,
    Room,
    displacement_on_cells,
    label_limit,
    outer_radius,
    strip_offset,
    varied_hazard,
)
from ..preparation.prepare import UNKNOWN
from ..preparation.relief_channels import hiding_scatter, relief_channels
from ..preparation.relief_channels import upside_down as inverted
from ..preparation.relief_raster import CELL_M
from .relief_structures import drawn_structures, structures

MARGIN_CELLS = 8
"""Cells around a patch from which its channels are computed, too."""
_MIN_POINTS = 400
_TRIES = 100
_NEED = 0.45
"""A hazard of 1 m width is near its limit at this height over the local scatter of relief over 3 m; the height grows
with the width to the power of ``_NEED_GROWTH``."""
_NEED_GROWTH = 0.6
Labels = NDArray[np.uint8]
_EXCHANGED = np.arange(256, dtype=np.uint8)
_EXCHANGED[[UPLIFT, SUBSIDENCE]] = SUBSIDENCE, UPLIFT


@dataclass(frozen=True)
class Ground:
    """A piece of ground to cut patches from, without known hazards unless ``labels`` say where they are.

    ``points`` (n, 3) m, any frame with z upwards, ``density`` in points/m². ``scales``: by how much it may be
    stretched. ``smooth``: free of noise, as elevation models are. ``weight``: how often it is drawn, compared with
    others of its half. ``labels`` (n,): class of each point, 255 where it is not known.

    Raises:
        InputError: too few points, or not as many labels as points.
    """

    name: str
    points: Float
    density: float
    scales: tuple[float, float] = (0.7, 1.4)
    smooth: bool = False
    weight: float = 1.0
    labels: Labels | None = None

    def __post_init__(self) -> None:
        if len(self.points) < _MIN_POINTS:
            raise InputError(
                f"The ground {self.name} has {len(self.points)} points; at least {_MIN_POINTS} are needed."
            )
        if self.labels is not None and len(self.labels) != len(self.points):
            raise InputError(
                f"The ground {self.name} has {len(self.points)} points and {len(self.labels)} labels; give as many."
            )
        if (np.diff(self.points[:, 0]) < 0).any():
            order = np.argsort(self.points[:, 0])
            object.__setattr__(self, "points", self.points[order])
            if self.labels is not None:
                object.__setattr__(self, "labels", self.labels[order])


@dataclass(frozen=True)
class Grounds:
    """What a network learns from; one of the two may be empty."""

    real: Sequence[Ground] = ()
    simulated: Sequence[Ground] = ()

    def __post_init__(self) -> None:
        if not self.names:
            raise InputError("There is no ground to train on; give real or simulated pieces.")

    @property
    def names(self) -> list[str]:
        return [ground.name for ground in (*self.real, *self.simulated)]


@dataclass(frozen=True)
class PatchParameters:
    """How patches are made; lengths in m, ranges are drawn from evenly by their logarithm.

    ``side`` in cells. ``densities``: points/m² that ground is thinned to. ``steepening``: of heights, beyond the
    stretch. ``noise`` of heights on ``smooth`` ground. ``turned``: share of patches turned to any side; the others keep
    y up the slope within ``tilt_deg``. ``offset``: standard deviation of the height between strips, on ``strips`` of
    the patches; ``holes``: share of the patches with gaps.
    Hazards cover ``filled`` of the ground on average and come independently of each other, as many on each patch as
    chance has it: if some patches had many and others none, a network would learn that hazards keep company, and one
    real hazard would raise false ones around it. ``diameters``; their heights are ``needs`` times what is needed at
    their place or, in half of the cases, ``heights``; ``varied`` is the share of forms with irregular outline.
    ``elongations``: width across the dip over length along it, before forms are turned. Diameters are those of circles
    of the same area. Changes of cliffs that surveyors marked as real have medians of 6.3 m width and 3 m length.
    ``structures``: share of the patches with scarps, gullies, drains, beams or boulders that are no hazards, whether or
    not there are hazards.
    """

    side: int = 96
    densities: tuple[float, float] = (1.5, 60.0)
    steepening: tuple[float, float] = (0.6, 1.6)
    noise: tuple[float, float] = (0.008, 0.06)
    turned: float = 0.3
    tilt_deg: float = 15.0
    offset: float = 0.05
    strips: float = 0.15
    holes: float = 0.3
    filled: float = 0.12
    diameters: tuple[float, float] = (1.3, 12.0)
    needs: tuple[float, float] = (0.8, 5.0)
    heights: tuple[float, float] = (0.12, 1.5)
    varied: float = 0.35
    elongations: tuple[float, float] = (0.4, 2.5)
    structures: float = 0.35

    def __post_init__(self) -> None:
        if self.side < 16 or self.side % 16:
            raise InputError(f"Patches have {self.side} cells a side; give a multiple of 16.")


@dataclass(frozen=True)
class Patch:
    """``channels`` (k, side, side) and ``labels`` (side, side): class, 255 where unknown or without ground."""

    channels: Float32
    labels: Labels

    def mirrored(self, *, along: bool = False, upside_down: bool = False) -> Patch:
        """The patch with x mirrored, and with heights mirrored, whose classes change places."""
        channels, labels = self.channels, self.labels
        if upside_down:
            channels, labels = inverted(channels), _EXCHANGED[labels]
        if along:
            channels, labels = channels[:, ::-1], labels[::-1]
        return Patch(channels, labels)


def draw_patch(grounds: Sequence[Ground], parameters: PatchParameters, rng: np.random.Generator) -> Patch:
    """A patch with hazards, and perhaps structures; the same generator state gives the same patch."""
    weights = np.array([ground.weight for ground in grounds])
    for _ in range(_TRIES):
        ground = grounds[int(rng.choice(len(grounds), p=weights / weights.sum()))]
        part = cut(ground, parameters, rng)
        if part is not None:
            break
    else:
        raise InputError("No patch with enough points was found on the ground to train on; give larger pieces.")
    size = parameters.side + 2 * MARGIN_CELLS
    cells = cell_heights(part.flat, CELL_M, np.zeros(2), (size, size))
    # Structures draw from a generator of their own, so that hazards are the same with and without them.
    built = np.random.default_rng(int(rng.integers(2**63)))
    names = drawn_structures(parameters.structures, built)
    cells = replace(cells, height=cells.height + structures(names, (size, size), CELL_M, built))
    own = None
    if part.labels is not None:
        place = np.floor(part.flat[:, :2] / CELL_M).astype(np.int64)
        own = cell_labels(place[:, 0], place[:, 1], part.labels, (size, size))
    moved, labels = insert_on_cells(cells, wanted_hazards(cells, parameters, rng, own), part.flat, rng, own)
    return _patch(replace(cells, height=cells.height + moved), labels)


@dataclass(frozen=True)
class Cut:
    """Points ``flat`` (n, 3) m of a place in the flat frame of a patch, from 0 to its side with margins in x and y, and
    their ``labels`` (n,) where the ground has such.
    """

    flat: Float
    labels: Labels | None


def cut(ground: Ground, parameters: PatchParameters, rng: np.random.Generator) -> Cut | None:
    """A random place of the ground, which may reach over its rim; None where there are too few points."""
    scale = _log_uniform(ground.scales, rng)
    width = (parameters.side + 2 * MARGIN_CELLS) * CELL_M
    points = ground.points
    middle = points[int(rng.integers(len(points))), :2] + rng.uniform(-0.25, 0.25, 2) * width / scale
    reach = 0.75 * width / scale
    chosen = np.arange(*np.searchsorted(points[:, 0], (middle[0] - reach, middle[0] + reach)))
    chosen = chosen[np.abs(points[chosen, 1] - middle[1]) < reach]
    wanted = _log_uniform(parameters.densities, rng) * scale**2
    if wanted < ground.density:
        chosen = chosen[rng.random(len(chosen)) < wanted / ground.density]
    if len(chosen) < _MIN_POINTS:
        return None
    part = points[chosen]
    angle = rng.uniform(0.0, 2 * math.pi) if rng.random() < parameters.turned else None
    level = np.median(part[np.argpartition(((part[:, :2] - middle) ** 2).sum(axis=1), 20)[:20], 2])
    flat = _laid_flat(part - [*middle, level], angle, math.radians(rng.normal(0.0, parameters.tilt_deg)))
    flat *= [scale, scale, scale * _log_uniform(parameters.steepening, rng)]
    flat[:, :2] += width / 2
    kept = np.flatnonzero(((flat[:, :2] >= 0) & (flat[:, :2] < width)).all(axis=1))
    if rng.random() < parameters.holes:
        kept = kept[_outside_holes(flat[kept], width, rng)]
    flat, chosen = flat[kept], chosen[kept]
    if len(flat) < _MIN_POINTS:
        return None
    if ground.smooth:
        flat[:, 2] += rng.normal(0.0, _log_uniform(parameters.noise, rng), len(flat))
    if rng.random() < parameters.strips:
        flat = strip_offset(flat, rng.normal(0.0, parameters.offset), rng)
    return Cut(flat, None if ground.labels is None else ground.labels[chosen])


def cell_labels(column: Index, row: Index, labels: Labels, shape: tuple[int, int]) -> Labels:
    """Class (columns, rows) that most points of each cell have: 255 where that is unknown, where as many points have
    another, and in cells without points.

    Args:
        column, row: (n,) of each point's cell. labels: (n,) classes or 255.
    """
    at = column * shape[1] + row
    kinds = (BACKGROUND, UPLIFT, SUBSIDENCE, UNKNOWN)
    votes = np.stack([np.bincount(at[labels == kind], minlength=shape[0] * shape[1]) for kind in kinds])
    most = votes.max(axis=0)
    clear = np.count_nonzero(votes == most, axis=0) == 1
    won = np.array(kinds, dtype=np.uint8)[votes.argmax(axis=0)]
    return np.where(clear & (most > 0), won, UNKNOWN).astype(np.uint8).reshape(shape)


def insert_on_cells(
    cells: CellHeights,
    wanted: Sequence[Hazard],
    flat: Float,
    rng: np.random.Generator,
    own: Labels | None = None,
) -> tuple[Float, Labels]:
    """Displacement (columns, rows) m by hazards at random places on ground with points ``flat``, and classes.

    Args:
        own: (columns, rows) classes of the ground itself (see ``cell_labels``). Hazards are put in where these are
            background, and what is unknown stays so, also in cells without points: which class they have is told
            nowhere, and hazards alone must not be.
    """
    room, fixed = Room(flat[:, :2]), np.zeros(cells.count.shape, dtype=bool)
    if own is not None:
        fixed = cells.covered & (own != BACKGROUND)
        room.keep_off(cells.origin + (np.argwhere(fixed) + 0.5) * cells.cell)
    shape = cells.count.shape[0], cells.count.shape[1]
    total = np.zeros(shape)
    labels = np.full(shape, BACKGROUND, dtype=np.uint8) if own is None else own.copy()
    for hazard in sorted(wanted, key=outer_radius, reverse=True):
        place = room.take(outer_radius(hazard), rng, 1.0)
        if place is None:
            continue
        i, j, moved = displacement_on_cells(replace(hazard, u=place[0], w=place[1]), cells.origin, cells.cell, shape)
        moved[fixed[i, j]] = 0.0  # some outlines end a little beyond their circle
        total[i, j] += moved
        limit = label_limit(hazard)
        labels[i, j] = np.where(moved > limit, UPLIFT, np.where(moved < -limit, SUBSIDENCE, labels[i, j]))
    return total, labels if own is None else np.where(cells.covered, labels, UNKNOWN).astype(np.uint8)


def wanted_hazards(
    cells: CellHeights, parameters: PatchParameters, rng: np.random.Generator, own: Labels | None = None
) -> list[Hazard]:
    """Hazards of all sizes for the ground of a patch, high enough to be near what can be found there or above it; for
    its background alone where ``own`` (columns, rows) says what it is.
    """
    ground = cells.covered if own is None else cells.covered & (own == BACKGROUND)
    unit = float(np.median(hiding_scatter(cells)[cells.covered]))
    narrow, wide = parameters.diameters
    usual_area = math.pi / 8 * (wide**2 - narrow**2) / math.log(wide / narrow)
    count = rng.poisson(parameters.filled * np.count_nonzero(ground) * cells.cell**2 / usual_area)
    found: list[Hazard] = []
    for _ in range(count):
        diameter = _log_uniform(parameters.diameters, rng)
        need = _NEED * unit * diameter**_NEED_GROWTH
        if rng.random() < 0.5:
            height = need * _log_uniform(parameters.needs, rng)
        else:
            height = max(_log_uniform(parameters.heights, rng), need * parameters.needs[0])
        form = varied_hazard if rng.random() < parameters.varied else smooth_hazard
        found.append(form(height * rng.choice((-1.0, 1.0)), diameter, rng, elongations=parameters.elongations))
    return found


def _patch(cells: CellHeights, labels: Labels) -> Patch:
    relief = relief_channels(cells)
    inner = slice(MARGIN_CELLS, -MARGIN_CELLS)
    labels = np.where(relief.covered, labels, UNKNOWN).astype(np.uint8)
    return Patch(np.ascontiguousarray(relief.channels[:, inner, inner]), labels[inner, inner])


def _laid_flat(points: Float, angle: float | None, tilt: float) -> Float:
    """Points about the origin on their own plane, turned by ``angle``, or y up the slope but for ``tilt`` (rad)."""
    middle = points.mean(axis=0)
    offsets = points - middle
    normal = np.linalg.eigh(offsets.T @ offsets)[1][:, 0]
    normal = normal if normal[2] > 0 else -normal
    up = np.array([0.0, 0.0, 1.0]) - normal * normal[2]
    if np.linalg.norm(up) < 0.05 or angle is not None:
        side = np.array([math.cos(angle or 0.0), math.sin(angle or 0.0), 0.0])
        up = side - normal * (side @ normal)
    up /= np.linalg.norm(up)
    right = np.cross(up, normal)
    up, right = math.cos(tilt) * up + math.sin(tilt) * right, math.cos(tilt) * right - math.sin(tilt) * up
    # The place in question stays at the origin of the flat frame, not the points' mean.
    return np.asarray(points @ np.column_stack([right, up, normal]))


def _outside_holes(flat: Float, width: float, rng: np.random.Generator) -> NDArray[np.bool_]:
    places = rng.uniform(0.0, width, (int(rng.integers(3, 40)), 2))
    radii = np.exp(rng.uniform(math.log(0.4), math.log(3.0), len(places)))
    kept = np.ones(len(flat), dtype=bool)
    for place, radius in zip(places, radii, strict=True):
        kept &= (flat[:, 0] - place[0]) ** 2 + (flat[:, 1] - place[1]) ** 2 > radius**2
    return kept


def _log_uniform(limits: tuple[float, float], rng: np.random.Generator) -> float:
    return float(math.exp(rng.uniform(math.log(limits[0]), math.log(limits[1]))))
