"""A slope scene of one epoch with the truth about every point."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...engine.core.arrays import Float
from ...engine.geometry.hazard_shapes import Hazard
from ..frame import Frame
from . import landforms, structures
from .hazards import displacement
from .negatives import Negative
from .placing import place_hazards
from .residue import clipped_crests, grow_cover, spike_heights
from .scan import Hits, plan_strips, scan
from .styles import THRESHOLD, SceneSpec, draw_spec, style_of
from .surface import Surface, smooth_line
from .terrain import Terrain, build_terrain

IGNORE_BAND = 0.5
"""Points whose displacement is within this share of the label's limit, on either side of it, are not trained on."""
BACKGROUND, UPLIFT, SUBSIDENCE = 0, 1, 2

HAZARD_FIELDS = np.dtype(
    [
        ("id", np.int32),
        ("hazard", np.int32),
        ("kind", "U16"),
        ("label", np.uint8),
        ("amplitude", np.float64),
        ("size", np.float64),
        ("area", np.float64),
        ("x", np.float64),
        ("y", np.float64),
    ]
)


@dataclass(frozen=True)
class SimulatedScene:
    """The ground points of a simulated slope and what is known about them.

    ``xyz`` (n, 3) in metres of a projected frame, to the millimetre. Per point: ``label`` (0 background, 1 uplift,
    2 subsidence), ``ignore`` (too close to the limit between labels to be trained on; scores count it), ``negative``
    (``Negative``), ``hazard`` (id in ``hazards``, -1 where there is none), ``displacement`` (m, along the normal of the
    mean plane) and ``strip``.

    ``hazards`` (fields ``HAZARD_FIELDS``) has a row for each labelled part of a hazard: a slump has two. ``hazard``
    numbers the whole, ``amplitude`` is the part's largest displacement (m), ``area`` its labelled area (m² of the
    mean plane), ``size`` the diameter of a circle of that area, x and y the place of its middle.

    ``limit`` (m) is the displacement from which a point is labelled; ``dip`` (degrees) and ``frame.dip_azimuth`` give
    the mean plane, ``area`` its surveyed part (m²).
    """

    spec: SceneSpec
    xyz: Float
    label: NDArray[np.uint8]
    ignore: NDArray[np.bool_]
    negative: NDArray[np.uint8]
    hazard: NDArray[np.int32]
    displacement: NDArray[np.float32]
    strip: NDArray[np.uint8]
    hazards: NDArray[np.void]
    limit: float
    dip: float
    frame: Frame
    area: float

    def __len__(self) -> int:
        return len(self.xyz)

    @property
    def shares(self) -> tuple[float, float, float]:
        """Shares of background, uplift and subsidence among the points."""
        count = np.bincount(self.label, minlength=3) / max(1, len(self.label))
        return float(count[0]), float(count[1]), float(count[2])

    def to_plane(self, xyz: Float) -> Float:
        """(n, 3) projected coordinates in the frame of the mean plane: u along the strike, w up the dip, n outwards."""
        local = self.frame.to_local(xyz)
        c, s = math.cos(math.radians(self.dip)), math.sin(math.radians(self.dip))
        plane = local.copy()
        plane[:, 1] = local[:, 1] * c + local[:, 2] * s
        plane[:, 2] = local[:, 2] * c - local[:, 1] * s
        return plane


def scene(
    seed: int, kind: str = "published", *, area: float | None = None, density: float | None = None
) -> SimulatedScene:
    """The scene of ``kind`` (published, realistic or shifted) with this seed.

    Raises:
        InputError: the kind is not known, or the seed is negative.
    """
    return build_scene(draw_spec(seed, kind, area=area, density=density))


def build_scene(spec: SceneSpec) -> SimulatedScene:
    """The scene that a specification describes; the same one gives the same points."""
    style = style_of(spec.kind)
    terrain = build_terrain(spec, spec.generator(1))
    surface = terrain.surface
    cells = _add_negatives(terrain, spec, spec.generator(2))
    rng = spec.generator(3)
    noise = rng.uniform(*style.range_noise)
    limit = max(THRESHOLD, 2.0 * math.hypot(noise, terrain.fine_rms))
    hazards = place_hazards(surface, style, (spec.uplift, spec.subsidence), limit, cells, rng)
    dz, part = _displace(surface, hazards, limit)
    surface.height += dz

    rng = spec.generator(4)
    strips = plan_strips(surface, terrain.dip, style, rng)
    cover = grow_cover(surface, style, rng)
    clipped, stride = clipped_crests(surface, rng)
    lost = float(cover.passes.mean()) * (1.0 - 0.9 * float(clipped.mean()))
    hits = scan(surface, strips, round(1.03 * spec.points / max(lost, 0.05)), style, rng)
    keep = rng.random(len(hits.u), dtype=np.float32) < cover.at(cover.passes, hits.u, hits.w)
    keep &= _within_outline(surface, hits, rng)
    node = _nearest(surface, hits.u, hits.w)
    off = clipped[node[0] // stride, node[1] // stride]
    keep &= ~off | (rng.random(len(off), dtype=np.float32) < 0.1)
    chosen = np.flatnonzero(keep)
    u, w, tangent = hits.u[chosen], hits.w[chosen], hits.tangent[chosen]
    flat = node[0][chosen] * surface.shape[1] + node[1][chosen]
    n, moved = _bilinear(surface, (surface.height, dz), u, w)

    negative = surface.negative.ravel()[flat]
    negative[hits.seam[chosen] & (negative == Negative.NONE)] = Negative.SEAM
    spike = rng.random(len(u), dtype=np.float32) < cover.at(cover.spikes, u, w)
    negative[spike] = Negative.RESIDUE

    # Range noise lies along the ray; strip offsets and spikes lie along the world's vertical.
    cosine = 1.0 / np.sqrt(1.0 + tangent * tangent)
    error = rng.standard_normal(len(u), dtype=np.float32) * noise * cosine
    n -= error
    w += error * tangent
    lift = np.array([strip.offset for strip in strips])[hits.strip[chosen]]
    lift[spike] += spike_heights(int(spike.sum()), rng)
    c, s = math.cos(terrain.dip), math.sin(terrain.dip)
    local = np.empty((len(u), 3))
    local[:, 0] = u
    local[:, 1] = w * c - n * s
    local[:, 2] = w * s + n * c + lift
    frame = _frame(rng)
    xyz = frame.to_world(local)
    np.round(xyz, 3, out=xyz)

    magnitude = np.abs(moved)
    side = np.where(moved > 0, np.uint8(UPLIFT), np.uint8(SUBSIDENCE))
    label = np.where(magnitude > limit, side, np.uint8(BACKGROUND))
    ignore = np.abs(magnitude - limit) < IGNORE_BAND * limit
    identity = part.ravel()[flat]
    table = _table(surface, hazards, dz, part, limit, frame, terrain.dip)
    return SimulatedScene(
        spec, xyz, label, ignore, negative, identity, moved.astype(np.float32), hits.strip[chosen], table,
        limit, math.degrees(terrain.dip), frame, surface.extent[0] * surface.extent[1],
    )  # fmt: skip


def _add_negatives(terrain: Terrain, spec: SceneSpec, rng: np.random.Generator) -> list[structures.Cell]:
    """Structures and landforms, each kind with its style's probability; natural ones first, since people build on
    them.
    """
    order = (
        "facets", "terracettes", "steps", "rills", "gullies", "lattice", "ditches", "drains", "stairs", "pipes",
        "boulders", "spoil", "stumps",
    )  # fmt: skip
    cells: list[structures.Cell] = []
    for name in order:
        if rng.random() >= style_of(spec.kind).negatives.get(name, 0.0):
            continue
        if name == "lattice":
            cells = structures.lattice(terrain, rng)
        else:
            getattr(structures if hasattr(structures, name) else landforms, name)(terrain, rng)
    return cells


def _displace(surface: Surface, hazards: list[Hazard], limit: float) -> tuple[NDArray[np.float32], NDArray[np.int32]]:
    """Displacement at every node, and the id of the labelled part there: twice the hazard's number, odd where
    lowered.
    """
    dz = np.zeros(surface.shape, dtype=np.float32)
    part = np.full(surface.shape, -1, dtype=np.int32)
    strongest = np.zeros(surface.shape, dtype=np.float32)
    for number, hazard in enumerate(hazards):
        rows, columns, moved = displacement(hazard, surface)
        dz[rows, columns] += moved
        magnitude = np.abs(moved)
        mine = (magnitude > 0.5 * limit) & (magnitude > strongest[rows, columns])
        strongest[rows, columns][mine] = magnitude[mine]
        part[rows, columns][mine] = 2 * number + (moved[mine] < 0)
    return dz, part


def _table(
    surface: Surface,
    hazards: list[Hazard],
    dz: NDArray[np.float32],
    part: NDArray[np.int32],
    limit: float,
    frame: Frame,
    dip: float,
) -> NDArray[np.void]:
    """The table of the hazards' labelled parts within the surveyed area."""
    rows, columns = surface.window(0.0, 0.0, *surface.extent)
    inner_part, inner_dz = part[rows, columns], dz[rows, columns]
    where = np.flatnonzero((np.abs(inner_dz) > limit) & (inner_part >= 0))
    identity, moved = inner_part.ravel()[where].astype(np.intp), inner_dz.ravel()[where]
    i, j = np.divmod(where, inner_part.shape[1])
    count = np.bincount(identity, minlength=2 * len(hazards))
    present = np.flatnonzero(count)
    amplitude = np.zeros(len(count), dtype=moved.dtype)
    np.maximum.at(amplitude, identity, np.abs(moved))
    with np.errstate(invalid="ignore", divide="ignore"):
        middle = np.stack([np.bincount(identity, weights=x, minlength=len(count)) / count for x in (i, j)], axis=1)
    place = np.zeros((len(present), 3))
    uw = surface.low + surface.step * (middle[present] + (rows.start, columns.start))
    place[:, 0], place[:, 1], place[:, 2] = uw[:, 0], uw[:, 1] * math.cos(dip), uw[:, 1] * math.sin(dip)
    world = frame.to_world(place)
    table = np.zeros(len(present), dtype=HAZARD_FIELDS)
    table["id"], table["hazard"] = present, present // 2
    table["kind"] = [hazards[k // 2].kind for k in present]
    table["label"] = np.where(present % 2, SUBSIDENCE, UPLIFT)
    table["amplitude"] = amplitude[present]
    table["area"] = count[present] * surface.step**2
    table["size"] = 2 * np.sqrt(table["area"] / math.pi)
    table["x"], table["y"] = world[:, 0], world[:, 1]
    return table


def _frame(rng: np.random.Generator) -> Frame:
    """Somewhere in a projected reference system, facing anywhere."""
    east, north = rng.uniform(300_000, 700_000), rng.uniform(2_500_000, 4_500_000)
    return Frame(round(east, 1), round(north, 1), round(rng.uniform(5, 900), 1), round(rng.uniform(0, 360), 2))


def _nearest(surface: Surface, u: Float, w: Float) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """Indices of the nodes nearest to (u, w)."""
    i = ((u - surface.low) * (1 / surface.step) + 0.5).astype(np.int32)
    j = ((w - surface.low) * (1 / surface.step) + 0.5).astype(np.int32)
    return i, j


def _bilinear(surface: Surface, fields: tuple[NDArray[np.float32], ...], u: Float, w: Float) -> list[Float]:
    """Fields of the surface's nodes at (u, w), m."""
    row, column = (u - surface.low) * (1 / surface.step), (w - surface.low) * (1 / surface.step)
    i, j = row.astype(np.int32), column.astype(np.int32)
    row -= i
    column -= j
    index = i.astype(np.intp)
    index *= surface.shape[1]
    index += j
    found = []
    for field in fields:
        flat = field.ravel()
        low, high = (
            _between(part.take(index), part[1:].take(index), column) for part in (flat, flat[surface.shape[1] :])
        )
        found.append(_between(low, high, row))
    return found


def _between(low: NDArray[np.floating], high: NDArray[np.floating], part: Float) -> Float:
    """low + part (high - low); ``high`` is changed."""
    high -= low
    value = part * high
    value += low
    return value


def _within_outline(surface: Surface, hits: Hits, rng: np.random.Generator) -> NDArray[np.bool_]:
    """Points within the region of interest, whose edges are drawn by hand: they wander by half a metre."""
    inside = np.ones(len(hits.u), dtype=bool)
    for along, across, length in ((hits.w, hits.u, surface.extent[0]), (hits.u, hits.w, surface.extent[1])):
        stations, place = 2 + int(along.max() / 0.5), (along * 2.0).astype(np.intp)
        for start, sign in ((0.0, 1.0), (length, -1.0)):
            line = 0.5 * np.abs(smooth_line(stations, 0.5, 15.0, rng))
            inside &= sign * (across - start) >= line.take(place, mode="clip")
    return inside
