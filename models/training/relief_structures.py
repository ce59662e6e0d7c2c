"""Structures that are no hazards, put into patches of ground: scarps, gullies, drains, beams, boulders.

Elevation models and forest ground have few of the built and eroded forms of road slopes, which a network otherwise
takes for hazards. Each function draws a structure of physical size and gives the displacement (columns, rows) m, square
to the slope, of cells of ``cell`` m from 0 on; y runs up the slope. All values are means over the cells: a beam
narrower than a cell is lower there. For a straight form that mean is exact, as a square seen along a line is a
trapezoid.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ...engine.core.arrays import Float

SCARP_HEIGHTS_M, SCARP_EDGES_M = (0.1, 1.0), (0.3, 1.5)
GULLY_WIDTHS_M, GULLY_DEPTHS_M = (0.5, 3.0), (0.1, 0.8)
DRAIN_WIDTHS_M, DRAIN_DEPTHS_M = (0.4, 1.5), (0.1, 0.5)
BEAM_WIDTHS_M, BEAM_HEIGHTS_M, BEAM_SPACINGS_M = (0.3, 0.8), (0.1, 0.5), (2.0, 6.0)
BOULDER_WIDTHS_M, BOULDER_HEIGHTS_M, BOULDER_COUNTS = (0.3, 1.5), (0.1, 0.6), (3, 30)
MAX_BOULDER_STEEPNESS = 0.7
"""Boulders are not higher than this part of their width."""
MOST_STRUCTURES = 3
_TABLE_STEPS = 100
"""Steps per cell at which a cross section is averaged."""
_SUBCELLS = 5
"""Samples along a cell's side for boulders."""
_UP = math.pi / 2

Shape = tuple[int, int]


@dataclass(frozen=True)
class Course:
    """A line through ``x``, ``y`` (m) that runs along ``angle`` (rad from x towards y) there, with a curvature ``bend``
    (1/m) and waves of ``wave`` m height and ``length`` m.
    """

    x: float
    y: float
    angle: float
    bend: float = 0.0
    wave: float = 0.0
    length: float = 20.0
    phase: float = 0.0

    @property
    def normal(self) -> tuple[float, float]:
        """Unit vector to the side where distances are positive: left of the course."""
        return -math.sin(self.angle), math.cos(self.angle)


def coordinates(shape: Shape, cell: float, course: Course) -> tuple[Float, Float]:
    """Way along a course and distance from it, positive on its left, of the cells' middles; both (columns, rows) m."""
    x = (np.arange(shape[0])[:, None] + 0.5) * cell - course.x
    y = (np.arange(shape[1])[None, :] + 0.5) * cell - course.y
    c, s = math.cos(course.angle), math.sin(course.angle)
    along, across = x * c + y * s, y * c - x * s
    if not (course.bend or course.wave):
        return along, across
    turns = 2 * math.pi / course.length
    at = turns * along + course.phase
    sideways = course.bend / 2 * along**2 + course.wave * np.sin(at)
    slope = course.bend * along + course.wave * turns * np.cos(at)
    return along, (across - sideways) / np.sqrt(1.0 + slope**2)


def mean_section(
    section: Callable[[Float], Float], reach: float, across: Float, normal: tuple[float, float], cell: float
) -> Float:
    """Means over square cells of a form that depends on the distance from a line alone.

    Args:
        section: height over distance (m), constant beyond ``reach`` m on either side.
        across: distance of the cells' middles from the line, m.
        normal: unit vector across the line.
    """
    step = cell / _TABLE_STEPS
    # The cell's shadow on the normal: two boxes folded, a trapezoid.
    long, short = sorted((abs(part) * cell for part in normal), reverse=True)
    short = max(short, step)
    half = math.ceil((long + short) / 2 / step)
    shadow = np.clip(((long + short) / 2 - np.abs(np.arange(-half, half + 1)) * step) / short, 0.0, 1.0)
    count = math.ceil((reach + cell) / step)
    places = np.arange(-count - half, count + half + 1, dtype=np.float64) * step
    means = np.convolve(section(places), shadow / shadow.sum(), mode="valid")
    return np.interp(across, places[half:-half], means)


def scarp(shape: Shape, cell: float, rng: np.random.Generator) -> Float:
    """A step along a gently curved line, more often across the slope: the edge of a bench, through the whole patch, or
    one that fades towards its ends and with the distance from it.
    """
    angle = rng.normal(0.0, math.radians(25)) if rng.random() < 0.8 else rng.uniform(0, math.pi)
    course = _course(shape, cell, float(angle), rng, curved=True)
    along, across = coordinates(shape, cell, course)
    height = _log_uniform(SCARP_HEIGHTS_M, rng) * rng.choice((-1.0, 1.0))
    edge = _log_uniform(SCARP_EDGES_M, rng)
    step = mean_section(lambda d: np.clip(d / edge, -0.5, 0.5), edge / 2, across, course.normal, cell)
    length, fall = _log_uniform((25.0, 80.0), rng), _log_uniform((8.0, 40.0), rng)
    if rng.random() < 0.5:
        # Long and slow to fade: ground beside a short one would be a bulge next to a hollow, and that is a hazard.
        ends = np.clip((length / 2 - np.abs(along)) / (0.3 * length), 0.0, 1.0)
        step *= ends**2 * (3 - 2 * ends) * np.exp(-np.abs(across) / fall)
    return np.asarray(height * step)


def gully(shape: Shape, cell: float, rng: np.random.Generator) -> Float:
    """A winding furrow of V or U section from a head on down the slope, deeper the farther it is from there."""
    course = _course(shape, cell, -_UP + float(rng.normal(0.0, math.radians(15))), rng, curved=True)
    along, across = coordinates(shape, cell, course)
    half, depth = _log_uniform(GULLY_WIDTHS_M, rng) / 2, _log_uniform(GULLY_DEPTHS_M, rng)
    power = float(rng.choice((1.0, 4.0)))
    section = mean_section(lambda d: _furrow(d, half, power), half, across, course.normal, cell)
    size = max(shape) * cell
    head, length = rng.uniform(-0.8, 0.2) * size, rng.uniform(0.5, 1.5) * size
    return np.asarray(-depth * section * np.sqrt(np.clip((along - head) / length, 0.0, 1.0)))


def drain(shape: Shape, cell: float, rng: np.random.Generator) -> Float:
    """A straight ditch of U section along or across the slope, sometimes with raised rims."""
    course = _course(shape, cell, _straight(rng), rng)
    half, depth = _log_uniform(DRAIN_WIDTHS_M, rng) / 2, _log_uniform(DRAIN_DEPTHS_M, rng)
    rim = rng.uniform(0.15, 0.5) if rng.random() < 0.4 else 0.0
    rim_half = rng.uniform(0.1, 0.3)
    across = coordinates(shape, cell, course)[1]
    reach = half + 2 * rim_half
    return depth * mean_section(lambda d: drain_section(d, half, rim, rim_half), reach, across, course.normal, cell)


def drain_section(across: Float, half: float, rim: float, rim_half: float) -> Float:
    """Height in depths of a ditch ``2 half`` m wide with rims ``rim`` high and ``2 rim_half`` m wide beside it."""
    return rim * _furrow(np.abs(across) - half - rim_half, rim_half, 2.0) - _furrow(across, half, 4.0)


def beams(shape: Shape, cell: float, rng: np.random.Generator) -> Float:
    """A straight ridge, or a lattice of crossing ones on a part of the patch or all of it."""
    course = _course(shape, cell, _straight(rng), rng)
    half, height = _log_uniform(BEAM_WIDTHS_M, rng) / 2, _log_uniform(BEAM_HEIGHTS_M, rng)
    spacings = _log_uniform(BEAM_SPACINGS_M, rng), _log_uniform(BEAM_SPACINGS_M, rng)
    bays = rng.integers(2, 13, 2)
    if rng.random() < 0.4:
        across = coordinates(shape, cell, course)[1]
        return height * mean_section(lambda d: _wall(d, half), half, across, course.normal, cell)
    return height * lattice(shape, cell, course, half, spacings, (int(bays[0]), int(bays[1])))


def lattice(
    shape: Shape, cell: float, course: Course, half: float, spacings: tuple[float, float], bays: tuple[int, int]
) -> Float:
    """Beams ``2 half`` m wide of height 1 along a straight course and across it, ``spacings`` m apart, about the
    course's middle: so many ``bays`` between those across and between those along it.
    """
    x, y = course.normal
    parts, within = [], []
    ways = zip(coordinates(shape, cell, course), ((y, -x), (x, y)), spacings, bays, strict=True)
    for way, normal, spacing, count in ways:
        number = np.clip(np.round(way / spacing + count / 2), 0, count) - count / 2
        parts.append(mean_section(lambda d: _wall(d, half), half, way - number * spacing, normal, cell))
        edge = count * spacing / 2 + half
        within.append(np.clip((edge - np.abs(way)) / cell + 0.5, 0.0, 1.0))
    # A beam ends at the outermost ones that it crosses; where two cross they are as high as one.
    return np.minimum(parts[0] * within[1] + parts[1] * within[0] - parts[0] * parts[1], 1.0)


def boulders(shape: Shape, cell: float, rng: np.random.Generator) -> Float:
    """A group of domes, most of them narrower than any hazard."""
    count = round(_log_uniform(BOULDER_COUNTS, rng))
    middle = rng.uniform(0.0, 1.0, 2) * shape * np.array(cell)
    places = middle + rng.normal(0.0, 1.0, (count, 2)) * np.exp(rng.uniform(math.log(1.5), math.log(10.0), 2))
    widths = np.exp(rng.uniform(math.log(BOULDER_WIDTHS_M[0]), math.log(BOULDER_WIDTHS_M[1]), count))
    low, high = BOULDER_HEIGHTS_M
    highest = np.minimum(high, MAX_BOULDER_STEEPNESS * widths)
    return domes(shape, cell, places, widths, low * (highest / low) ** rng.random(count))


def domes(shape: Shape, cell: float, places: Float, widths: Float, heights: Float) -> Float:
    """Half ellipsoids of ``widths`` and ``heights`` (n,) m at ``places`` (n, 2) m; the higher one where two overlap."""
    reach = math.ceil(widths.max() / 2 / cell)
    window = np.arange(-reach, reach + 1)
    first = np.floor(np.asarray(places) / cell).astype(np.int64)
    samples = (np.arange(window.size * _SUBCELLS) + 0.5) / _SUBCELLS - reach
    squares = [(((first[:, [k]] + samples) * cell - places[:, [k]]) / (widths[:, None] / 2)) ** 2 for k in (0, 1)]
    height = np.sqrt(np.maximum(1.0 - squares[0][:, :, None] - squares[1][:, None, :], 0.0))
    means = height.reshape(len(places), window.size, _SUBCELLS, window.size, _SUBCELLS).mean(axis=(2, 4))
    i, j = np.broadcast_arrays((first[:, [0]] + window)[:, :, None], (first[:, [1]] + window)[:, None, :])
    known = (i >= 0) & (i < shape[0]) & (j >= 0) & (j < shape[1])
    total = np.zeros(shape)
    np.maximum.at(total, (i[known], j[known]), (heights[:, None, None] * means)[known])
    return total


STRUCTURES: dict[str, Callable[[Shape, float, np.random.Generator], Float]] = {
    "scarp": scarp,
    "gully": gully,
    "drain": drain,
    "beams": beams,
    "boulders": boulders,
}


def drawn_structures(share: float, rng: np.random.Generator) -> list[str]:
    """The names of one to three structures for a ``share`` of the patches, none for the others."""
    if rng.random() >= share:
        return []
    return [str(name) for name in rng.choice(list(STRUCTURES), int(rng.integers(1, MOST_STRUCTURES + 1)))]


def structures(names: list[str], shape: Shape, cell: float, rng: np.random.Generator) -> Float:
    """Displacement (columns, rows) m of cells of ``cell`` m by the structures of these ``names``; the same generator
    state gives the same.
    """
    total = np.zeros(shape)
    for name in names:
        total += STRUCTURES[name](shape, cell, rng)
    return total


def _course(shape: Shape, cell: float, angle: float, rng: np.random.Generator, *, curved: bool = False) -> Course:
    """A line through a random place of the inner part of a patch; curves have radii of mostly above 40 m."""
    x, y = rng.uniform(0.15, 0.85, 2) * shape * np.array(cell)
    if not curved:
        return Course(float(x), float(y), angle)
    length = _log_uniform((8.0, 40.0), rng)
    wave = length * rng.uniform(0.0, 0.05)
    return Course(float(x), float(y), angle, rng.normal(0.0, 0.012), wave, length, rng.uniform(0, 2 * math.pi))


def _straight(rng: np.random.Generator) -> float:
    """An angle within some degrees of x or y."""
    return float(rng.choice((0.0, _UP)) + rng.normal(0.0, math.radians(4)))


def _furrow(across: Float, half: float, power: float) -> Float:
    """1 in the middle to 0 at ``half`` m from it: V for a power of 1, U for 4."""
    return np.asarray(np.maximum(1.0 - np.abs(across / half) ** power, 0.0))


def _wall(across: Float, half: float) -> Float:
    """A ridge with a flat top whose flanks take a tenth of its width each."""
    return np.asarray(np.clip((half - np.abs(across)) / (0.2 * half), 0.0, 1.0))


def _log_uniform(limits: tuple[float, float], rng: np.random.Generator) -> float:
    return float(math.exp(rng.uniform(math.log(limits[0]), math.log(limits[1]))))
