"""The ground in tiles, where heights over the triangles are known; and what is counted of it for the record."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from ....interface.parameters import GroundParameters
from ...core.arrays import Bool, Float
from ...geometry.dominant_plane import Plane, apply_matrix, unflattening_matrix
from ..bare_scatter import SAMPLE_SIDE_M, bare_scatter
from ..doubts import (
    SQUARE_POINTS,
    DoubtFacts,
    depth_below,
    even_sums,
    evenness,
    removed_below,
    square_counts,
    thin_area,
    thin_side,
)
from ..filtering import vertical
from ..layered_ground import (
    BARE_SCATTER_M,
    MAX_CLOSER_WINDOW_M,
    LayeredGround,
    Windows,
    layered_part,
    of_lowest_layers,
    window_side,
    windows_for,
)
from ..metrics import MIN_VEGETATION_HEIGHT_M, crown_cell, crown_heights
from ..tally import Tally, metre_squares, square_keys, square_places
from .layout import JUDGED_HALO_M
from .spool import FOUND, POINT, SURFACE, Around, Spool
from .surfaces import Cloth, Surfaces, near_cloth
from .survey import Kept

MAX_AREA_SQUARES = 4_000_000
"""Squares of the whole slope in which areas with hardly any return are looked for; larger squares where it is large."""
ERROR_STEP_M, ERROR_STEPS = 1e-4, 5000
"""Bins in which plant errors are counted for their median."""


@dataclass
class Counts:
    """Sums over the tiles for the warnings and the record; ``even`` as of ``even_sums``, the others are points.

    ``errors`` (ERROR_STEPS,) counts points by their plant error; ``thin`` points and ground returns by square.
    """

    ground: int = 0
    bare: int = 0
    deep: int = 0
    known: int = 0
    high_cells: int = 0
    cells: int = 0
    even: Float = field(default_factory=lambda: np.zeros(3))
    errors: Float = field(default_factory=lambda: np.zeros(ERROR_STEPS))
    thin: Tally = field(default_factory=lambda: Tally(2))


def windows_of(spool: Spool, surfaces: Surfaces, parameters: GroundParameters) -> Windows:
    """The windows of the whole cloud, from its returns near the triangles."""
    squares = Tally()
    for tile in range(len(spool.tiles)):
        squares.add(metre_squares(_low_returns(spool, tile) - [*surfaces.low_corner, 0.0, 0.0]))
    counts = squares.counts()
    side, bare_ground = window_side(counts.astype(np.int64)), BARE_SCATTER_M
    if len(counts) and side <= MAX_CLOSER_WINDOW_M:
        places = square_places(squares.found()[0])
        middle = np.array([_median(places[:, axis], counts) for axis in (0, 1)]) + 0.5 + surfaces.low_corner
        bare_ground = bare_scatter(_returns_about(spool, middle), side) or BARE_SCATTER_M
    single = surfaces.whole.single
    return windows_for(side, bare_ground, parameters.class_threshold, surfaces.strays, single=single)


def _low_returns(spool: Spool, tile: int) -> Float:
    """(n, 4) x, y, z and the height over the triangles of a tile's returns that take part in the windows."""
    points, surface = spool.load(tile, "points", POINT), spool.load(tile, "surface", SURFACE)
    chosen = of_lowest_layers(surface["height"], surface["left"])
    return np.column_stack([*(points[field][chosen] for field in "xyz"), surface["height"][chosen]])


def _returns_about(spool: Spool, middle: Float) -> Float:
    """(n, 4) as of ``_low_returns``, those in the square about ``middle`` (2,) that ``bare_scatter`` looks at."""
    found = [np.zeros((0, 4))]
    for tile in range(len(spool.tiles)):
        away = np.abs(spool.tiles.corner(tile) + spool.tiles.side / 2 - middle)
        if (away <= (spool.tiles.side + SAMPLE_SIDE_M) / 2).all():
            low = _low_returns(spool, tile)
            found.append(low[(np.abs(low[:, :2] - middle) <= SAMPLE_SIDE_M / 2).all(axis=1)])
    return np.vstack(found)


def judge(
    spool: Spool,
    surfaces: Surfaces,
    windows: Windows,
    plane: Plane,
    kept: Kept,
    done: Callable[[int], None],
) -> Counts:
    """The ground of every tile by its windows, saved as ``FOUND`` records with vertical heights."""
    counts, upright = Counts(), vertical(plane.dip)
    for tile in range(len(spool.tiles)):
        around, surface = spool.read(tile, JUDGED_HALO_M, [("surface", SURFACE)])
        found = layered_part(around.flat, surface["height"], surface["left"], windows, surfaces.whole.origin)
        records = np.empty(around.core, FOUND)
        for name, values in (("height", found.height), ("error", found.plant_error), ("plants", found.plant_height)):
            records[name] = values[: around.core] * upright
        records["ground"] = found.ground[: around.core]
        spool.save(tile, records, "found")
        _count(counts, spool, tile, around, found.ground, plane, kept)
        _count_heights(counts, around, found, _removed_in(spool, tile, kept))
        done(tile + 1)
    return counts


def label_by_cloth(spool: Spool, cloth: Cloth, kept: Kept, done: Callable[[int], None]) -> Counts:
    """The ground of every tile where the cloth alone decides, saved as ``FOUND`` records without heights."""
    counts = Counts()
    for tile in range(len(spool.tiles)):
        (around,) = spool.read(tile, JUDGED_HALO_M)
        ground = near_cloth(around, cloth) & around.taken
        records = np.zeros(around.core, FOUND)
        records["ground"] = ground[: around.core]
        spool.save(tile, records, "found")
        _count(counts, spool, tile, around, ground, cloth.plane, kept)
        done(tile + 1)
    return counts


def _count(counts: Counts, spool: Spool, tile: int, around: Around, ground: Bool, plane: Plane, kept: Kept) -> None:
    """Add what needs no heights: ground returns, plants seen from above, evenness and areas with few returns."""
    flat, core = around.flat, np.arange(len(around.flat)) < around.core
    counts.ground += int(np.count_nonzero(ground & core))
    xyz = apply_matrix(unflattening_matrix(plane), flat)
    cell = crown_cell(kept.spacing)
    # the inverse rotation moves the lowest point by some nanometres
    heights = crown_heights(xyz, flat, ground, plane.dip, cell, origin=kept.low - 1e-6, counted=core)
    counts.cells += len(heights)
    counts.high_cells += int(np.count_nonzero(heights > MIN_VEGETATION_HEIGHT_M))
    side = SQUARE_POINTS * kept.flat_spacing
    low = kept.flat_low + side * np.floor((flat[:, :2].min(axis=0) - kept.flat_low) / side)
    squares = square_counts(flat, side, low)
    middle = np.column_stack([axis.ravel() for axis in np.indices(squares.shape)]) * side + low + side / 2
    counts.even += even_sums(squares, spool.tiles.within(tile, middle, 0.0).reshape(squares.shape))
    place = np.floor((flat[: around.core, :2] - kept.flat_low) / area_side(kept)).astype(np.int64)
    keys, square = np.unique(square_keys(place), return_inverse=True)
    on_ground = np.bincount(square.ravel(), ground[: around.core], len(keys))
    counts.thin.add_sums(keys, np.vstack([np.bincount(square.ravel(), minlength=len(keys)), on_ground]))


def _count_heights(counts: Counts, around: Around, found: LayeredGround, removed: Float) -> None:
    """Add what heights over the ground say: strays below it, and plant errors."""
    core = slice(0, around.core)
    height, error, depth = found.height[core], found.plant_error[core], depth_below(found.threshold)
    known = np.isfinite(height) & around.taken[core]
    counts.known += int(np.count_nonzero(known))
    counts.deep += int(np.count_nonzero(height[known] < -depth))
    counts.deep += removed_below(removed, around.flat[found.ground], depth)
    error = error[np.isfinite(error)]
    counts.bare += int(np.count_nonzero(error == 0))
    steps = np.minimum((error / ERROR_STEP_M).astype(np.int64), ERROR_STEPS - 1)
    counts.errors += np.bincount(steps, minlength=ERROR_STEPS)


def _removed_in(spool: Spool, tile: int, kept: Kept) -> Float:
    """(m, 3) the outliers over or below a tile."""
    return kept.removed[spool.tiles.within(tile, kept.removed, 0.0)]


def area_side(kept: Kept) -> float:
    """Side (m) of the squares in which areas with hardly any return are looked for."""
    side = thin_side(kept.flat_spacing)
    return side * max(1.0, math.sqrt(float(np.prod(kept.flat_size)) / side**2 / MAX_AREA_SQUARES))


def doubt_facts(counts: Counts, windows: Windows | None, kept: Kept, lost: float) -> DoubtFacts:
    """What ``doubts`` looks at; ``windows`` is None where the cloth alone decided."""
    number, total, squares = counts.even.tolist()
    keys, sums = counts.thin.found()
    place = square_places(keys)
    grids = np.zeros((2, *(int(n) + 1 for n in place.max(axis=0))))
    grids[:, place[:, 0], place[:, 1]] = sums
    even = evenness(round(number), total, squares)
    thin = thin_area(grids[0], grids[1], area_side(kept))
    if windows is None:
        return DoubtFacts(lost, even, *thin)
    depth, everything = depth_below(windows.threshold), counts.known + len(kept.removed)
    known = counts.errors.sum()
    bare = counts.bare / known if known else math.nan
    error = float(_median(np.arange(ERROR_STEPS), counts.errors)) * ERROR_STEP_M if known else math.nan
    return DoubtFacts(lost, even, *thin, bare, error, counts.deep / max(everything, 1), depth)


def _median(values: np.ndarray, weight: np.ndarray) -> float:
    """The value below which half of the weight lies."""
    order = np.argsort(values, kind="stable")
    sums = np.cumsum(weight[order])
    return float(values[order][np.searchsorted(sums, 0.5 * sums[-1])])
