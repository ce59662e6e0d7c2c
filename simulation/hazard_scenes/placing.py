"""Which hazards a scene has and where: drawn until the labelled displacements cover the wanted shares of the slope."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ...engine.core.arrays import Float, Float32
from ...engine.geometry.hazard_shapes import LOWERS, RAISES, Hazard
from .hazards import displacement
from .structures import Cell
from .styles import Style, log_uniform
from .surface import Surface

COARSE = 0.2
"""Spacing (m) of the nodes on which hazards are tried."""
ATTEMPTS = 6
"""Places that are tried for one hazard."""
OVERLAP = 0.05
"""Share of a hazard that may lie on another one."""
ROUNDS = 8
"""How often hazards are drawn for what is still missing."""
LABELLED = 0.55
"""Share of a hazard's ellipse that is labelled, about: to draw enough of them at once."""


class _Cover:
    """What is displaced so far, at every ``stride``-th node, and how far every place is from it, up to ``widest`` m:
    more room than any hazard's circle needs.
    """

    def __init__(self, surface: Surface, limit: float, widest: float) -> None:
        self.surface, self.limit, self.widest = surface, limit, widest
        self.stride = max(1, round(COARSE / surface.step))
        self.dz = np.zeros([-(-nodes // self.stride) for nodes in surface.shape], dtype=np.float32)
        self.within = self.coarse(*surface.window(0.0, 0.0, *surface.extent, self.stride))
        u, w = (x[:: self.stride][part] for x, part in zip((surface.u, surface.w), self.within))
        self.u, self.w = u[::2, None], w[None, ::2]
        self.room = np.full((self.u.size, self.w.size), np.inf, dtype=np.float32)
        self.labelled = np.zeros(2, dtype=np.intp)

    def coarse(self, rows: slice, columns: slice) -> tuple[slice, slice]:
        """Slices of the coarse nodes that slices of the surface with this stride take."""
        spans = [slice(s.start // self.stride, -(-s.stop // self.stride)) for s in (rows, columns)]
        return spans[0], spans[1]

    def shares(self) -> Float:
        """(2,) shares of the surveyed part that are labelled uplift and subsidence."""
        return self.labelled / self.dz[self.within].size

    def add(self, place: tuple[slice, slice], dz: Float32) -> Float32:
        """Displace the nodes of the slices; what they were before, for ``restore``."""
        before = self.dz[place].copy()
        self.restore(place, before + dz)
        return before

    def restore(self, place: tuple[slice, slice], dz: Float32) -> None:
        """Let the nodes of the slices be displaced by ``dz`` in all."""
        self.labelled -= self._labelled_nodes(place)
        self.dz[place] = dz
        self.labelled += self._labelled_nodes(place)

    def _labelled_nodes(self, place: tuple[slice, slice]) -> NDArray[np.intp]:
        """(2,) surveyed nodes of the slices that are labelled uplift and subsidence."""
        rows, columns = (
            slice(max(a.start, b.start), min(a.stop, b.stop)) for a, b in zip(place, self.within, strict=True)
        )
        dz = self.dz[rows, columns]
        return np.array([np.count_nonzero(dz > self.limit), np.count_nonzero(dz < -self.limit)])

    def occupy(self, hazard: Hazard) -> None:
        """Places are no farther from anything than from this hazard's circle."""
        radius = _radius(hazard)
        rows, columns = (
            slice(*np.searchsorted(nodes.ravel(), (place - radius - self.widest, place + radius + self.widest)))
            for nodes, place in ((self.u, hazard.u), (self.w, hazard.w))
        )
        far = np.hypot(self.u[rows] - np.float32(hazard.u), self.w[:, columns] - np.float32(hazard.w))
        room = self.room[rows, columns]
        np.minimum(room, far - np.float32(radius), out=room)

    def free_nodes(self, radius: float) -> NDArray[np.intp]:
        """Flat indices of the nodes with that much room around them."""
        return np.flatnonzero(self.room.ravel() > radius)

    def place_near(self, node: int, rng: np.random.Generator) -> tuple[float, float]:
        """A random place that no other node is nearer to."""
        i, j = divmod(node, self.room.shape[1])
        u, w = rng.uniform(-0.5, 0.5, 2) * 2 * self.stride * self.surface.step
        return float(self.u[i, 0] + u), float(self.w[0, j] + w)


def place_hazards(
    surface: Surface,
    style: Style,
    targets: tuple[float, float],
    limit: float,
    cells: list[Cell],
    rng: np.random.Generator,
) -> list[Hazard]:
    """Hazards whose labelled parts cover the ``targets`` (shares of uplift and subsidence) of the slope.

    Args:
        limit: displacement (m) from which a point is labelled; hazards reach 1.5 times it.
        cells: of a lattice; collapsed cells are some of them.

    Hazards hardly overlap. The shares end within 0.4 % of the targets, unless the slope is full before.
    """
    cover, wanted = _Cover(surface, limit, style.hazard_size[1]), np.array(targets)
    area = surface.extent[0] * surface.extent[1]
    free_cells = list(rng.permutation(len(cells)))
    placed: list[Hazard] = []
    missing, slack = wanted, np.minimum(0.002, 0.06 * wanted + 0.0003)
    for _ in range(ROUNDS if wanted.max() > 0 else 0):
        drawn: list[Hazard] = []
        rest = missing * area
        while rest.max() > 0.001 * area:
            sign = 1 if rng.random() < max(rest[0], 0.0) / np.maximum(rest, 0.0).sum() else -1
            largest = 2 * math.sqrt(max(rest[0 if sign > 0 else 1], 0.0) / LABELLED / math.pi) + 0.3
            largest = min(largest, style.hazard_size[1])
            hazard = _draw(style, sign, largest, limit, free_cells, cells, rng)
            drawn.append(hazard)
            rest = rest - LABELLED * math.pi * hazard.half_u * hazard.half_w * _part(hazard)
        # Large ones first: they find no room later.
        for hazard in sorted(drawn, key=lambda h: -h.half_u * h.half_w):
            found = _find_place(hazard, cover, rng)
            if found is None:
                continue
            hazard, place, dz = found
            before = cover.add(place, dz)
            left = wanted - cover.shares()
            if (left < -slack).any():
                cover.restore(place, before)
                continue
            placed.append(hazard)
            cover.occupy(hazard)
            missing = left
        if (missing <= slack).all():
            break
    return placed


def _radius(hazard: Hazard) -> float:
    """Of the circle that a hazard keeps free of others: its profile fades towards the outline."""
    return 0.8 * math.sqrt(hazard.half_u * hazard.half_w)


def _part(hazard: Hazard) -> Float:
    """Shares of uplift and subsidence in a hazard's labelled area, about."""
    if hazard.kind in RAISES & LOWERS or (hazard.second and hazard.kind == "slump"):
        return np.array([0.5, 0.4])
    return np.array([1.0, 0.0]) if hazard.height > 0 else np.array([0.0, 1.0])


def _find_place(
    hazard: Hazard, cover: _Cover, rng: np.random.Generator
) -> tuple[Hazard, tuple[slice, slice], Float32] | None:
    """The hazard moved to a free place, its coarse slices and displacement there; None where none was found."""
    free = None if hazard.u != 0.0 else cover.free_nodes(_radius(hazard))
    if free is not None and not len(free):
        return None
    for _ in range(1 if free is None else ATTEMPTS):
        if free is not None:
            u, w = cover.place_near(int(free[rng.integers(len(free))]), rng)
            hazard = replace(hazard, u=u, w=w, shift=int(rng.integers(0, 512)))
        rows, columns, dz = displacement(hazard, cover.surface, cover.stride)
        slices = cover.coarse(rows, columns)
        body = np.abs(dz) > 0.5 * cover.limit
        count = np.count_nonzero(body)
        taken = np.count_nonzero(np.abs(cover.dz[slices][body]) > 0.5 * cover.limit)
        if count and taken <= OVERLAP * count:
            return hazard, slices, dz
    return None


def _draw(
    style: Style,
    sign: int,
    largest: float,
    limit: float,
    free_cells: list[int],
    cells: list[Cell],
    rng: np.random.Generator,
) -> Hazard:
    """A hazard of a kind that adds uplift (``sign`` 1) or subsidence (-1), not yet placed (u = 0) unless in a cell."""
    kinds = [kind for kind in style.hazards if kind in (RAISES if sign > 0 else LOWERS)]
    weights = np.array([style.hazards[kind] for kind in kinds])
    kind = str(rng.choice(kinds, p=weights / weights.sum()))
    smallest = min(style.hazard_size[0], largest)
    size = log_uniform((smallest, max(largest, smallest)), rng)
    ratio = log_uniform((0.6, 1.7), rng)
    half_u, half_w = size / 2 * math.sqrt(ratio), size / 2 / math.sqrt(ratio)
    heights = style.bulge_height if sign > 0 else style.depression_depth
    # Ground does not heave by more than about a quarter of the width of what moves.
    high = min(heights[1], 0.25 * size)
    height = sign * log_uniform((min(max(heights[0], 1.5 * limit, 0.02 * size), high), high), rng)
    base = Hazard(
        kind,
        0.0,
        0.0,
        half_u,
        half_w,
        height,
        exponent=rng.uniform(1.8, 4.0),
        flatness=rng.uniform(1.5, 5.0),
        fall=rng.uniform(0.8, 2.0),
        skew=rng.uniform(-0.3, 0.5),
        turn=rng.uniform(-0.4, 0.4),
        wobble=rng.uniform(0.05, 0.18),
    )
    return _particular(base, sign, free_cells, cells, rng)


def _particular(base: Hazard, sign: int, free_cells: list[int], cells: list[Cell], rng: np.random.Generator) -> Hazard:
    """What is special to the hazard's kind."""
    size = 2 * math.sqrt(base.half_u * base.half_w)
    kind = base.kind
    if kind == "toe_bulge":
        return replace(base, skew=rng.uniform(0.5, 0.75), flatness=rng.uniform(2.5, 5.0), fall=rng.uniform(0.6, 1.0))
    if kind == "cracked_bulge":
        crack = -rng.uniform(0.08, 0.25) if size > 2.0 else -0.06
        return replace(base, second=crack, exponent=2.0, skew=0.0, wobble=0.05, fall=rng.uniform(0.6, 1.2))
    if kind == "slump":
        long = base.half_w * rng.uniform(1.1, 1.6)
        return replace(base, half_w=long, second=-base.height * rng.uniform(0.3, 0.8), exponent=rng.uniform(2.0, 4.0))
    if kind == "scarp_and_bulge":
        other = base.height * rng.uniform(0.4, 1.2)
        height, second = (-other, base.height) if sign > 0 else (base.height, -other)
        return replace(base, half_w=base.half_w * rng.uniform(1.1, 1.5), height=height, second=second, wobble=0.08)
    if kind == "graben":
        return replace(
            base, half_u=1.4 * base.half_u, half_w=0.7 * base.half_w, second=-base.height * rng.uniform(0, 0.6)
        )
    if kind == "trough":
        narrow = min(base.half_u * rng.uniform(0.25, 0.45), 1.2)
        turn = rng.uniform(-math.pi / 2, math.pi / 2)
        return replace(base, half_u=narrow, half_w=1.5 * base.half_w, turn=turn, height=max(base.height, -0.6 * narrow))
    if kind == "collapsed_cell" and free_cells:
        cell = cells[free_cells.pop()]
        return replace(base, u=cell.u, w=cell.w, half_u=cell.half_u, half_w=cell.half_w, turn=cell.turn, wobble=0.02)
    if kind == "collapsed_cell":
        return replace(base, wobble=0.04, half_u=min(base.half_u, 2.0), half_w=min(base.half_w, 2.0))
    if kind == "lobes":
        return replace(base, half_w=1.4 * base.half_w, height=0.7 * base.height)
    if kind == "block":
        return replace(base, wobble=0.03, turn=rng.uniform(-0.8, 0.8))
    return base
