"""The ground of each zone: where it moved by a tenth of the most or more."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from ..change.result import Change
from ..core.arrays import Bool, Float, Index
from ..core.progress import Progress
from ..grid.block_moments import PLAIN_SUMS
from ..grid.cell_statistics import CellStatistics
from ..grid.grid import Grid
from ..grid.kept_moments import KeptMoments
from ..zones.change_zones import cells_of
from ..zones.footprints import Cells, Footprint, in_window, outline_footprints
from .joint_motion import between, joint_motion
from .tracking import Track

LEAST_SHARE = 0.1
"""Of the largest motion of a zone: ground that moved by less is not the zone's."""
_MIDDLE_SHARE = 0.25  # of a zone's measured cells, the innermost: their mean change is that of its middle
_RINGS_A_CELL = 2
_MARGIN_SHARE = 0.25  # of a footprint's extent: ground around it that is fitted as well
_MIN_MARGIN_CELLS = 3
_SAMPLES_A_CELL = 8  # a side: in how many parts a cell is cut by the outline

Kept = Callable[[], CellStatistics | KeptMoments]


@dataclass(frozen=True)
class Ground:
    """The ground of a zone: its ``cells`` (flat indices), and where the sums of the surveys' points are kept, its mean
    ``change`` in height against the first survey (surveys,), m, with the ``variance`` by the points alone, m².
    """

    cells: Index
    change: Float | None = None
    variance: Float | None = None


@dataclass(frozen=True)
class _Found:
    """A zone in the survey in which its volume is largest: where its ``footprint`` lies (``window``), and the part of
    it that moved by the means of whole rings (``inside``).
    """

    window: tuple[slice, ...]
    footprint: Bool
    inside: Bool


def zone_grounds(
    tracks: Sequence[Track],
    changes: Sequence[Change],
    gap: float,
    surveys: Sequence[Kept] = (),
    progress: Progress | None = None,
) -> list[Ground]:
    """Each zone's ground.

    Of the surveys that saw the zone, that in which its volume is largest gives the footprint
    (``footprints.outline_footprints``). Of this, the ground is what moved by at least ``LEAST_SHARE`` of the most.
    Where the sums of all surveys' points are kept, they show it (``joint_motion``); else the mean change of whole rings
    of the footprint does.

    Args:
        changes: of the surveys from the second on against the first.
        gap: metres, see ``outline_footprints``.
        surveys: read the cells of each survey, the first included.
    """
    grid, progress = changes[0].grid, progress or Progress()
    found, largest = [_whole(track, grid) for track in tracks], np.zeros(len(tracks))
    seen = [{s.epoch for s in track.sightings} for track in tracks]
    means = np.zeros((len(tracks), len(changes) + 1))
    for survey, change in enumerate(changes, 1):
        means[:, survey] = [_mean(change, track.footprint) for track in tracks]
        if not any(survey in epochs for epochs in seen):
            continue
        labels = _labels(tracks, grid)
        number_of = np.unique(labels[labels > 0])
        cells, outlines = cells_of(change), labels.copy()
        outlines[labels > 0] = np.searchsorted(number_of, labels[labels > 0]) + 1
        footprints = outline_footprints(
            cells, outlines, len(number_of), gap=gap, registration_error=change.registration_error
        )
        for number, footprint in zip((number_of - 1).tolist(), footprints, strict=True):
            near = in_window(cells, footprint.window)
            volume = abs(float(np.sum(footprint.weights * np.nan_to_num(near.dz))))
            if survey in seen[number] and volume > largest[number]:
                largest[number] = volume
                own = labels[footprint.window] == number + 1
                found[number] = _Found(footprint.window, footprint.inside | own, _moved(near, own, footprint))
    loaded = (read() for read in surveys)
    kept = [one for one in loaded if isinstance(one, KeptMoments)]
    if len(kept) != len(changes) + 1:
        return [Ground(_flat(one.window, one.inside, grid)) for one in found]
    grounds = []
    for number, one in enumerate(found):
        progress.update(1.0, f"outlining zone {number + 1} of {len(found)}")
        grounds.append(_sharp(one, tracks[number], means[number], kept, grid))
    return grounds


def _labels(tracks: Sequence[Track], grid: Grid) -> np.ndarray:
    labels = np.zeros(grid.shape, dtype=np.int32)
    for number, track in enumerate(tracks, 1):
        labels.ravel()[track.footprint] = number
    return labels


def _whole(track: Track, grid: Grid) -> _Found:
    """All cells of a track."""
    row, column = np.divmod(track.footprint, grid.columns)
    window = slice(int(row.min()), int(row.max()) + 1), slice(int(column.min()), int(column.max()) + 1)
    inside = np.zeros([s.stop - s.start for s in window], dtype=bool)
    inside[row - window[0].start, column - window[1].start] = True
    return _Found(window, inside, inside)


def _mean(change: Change, cells: Index) -> float:
    """Change of the cells that were measured, metres; 0 where there is none, or all moved alike."""
    dz = change.dz.ravel()[cells]
    known = np.isfinite(dz)
    return float(dz[known].mean()) if known.any() and change.uniform_dz is None else 0.0


def _flat(window: tuple[slice, ...], inside: Bool, grid: Grid) -> Index:
    row, column = np.nonzero(inside)
    flat: Index = (row + window[0].start) * grid.columns + column + window[1].start
    return flat


def _moved(cells: Cells, own: Bool, footprint: Footprint) -> Bool:
    """The footprint without its rim of ground that hardly moved.

    Ring by ring from the inside, up to the ring whose mean change is less than a share of that in the middle. Means of
    whole rings decide, so that noise does not choose single cells.

    Args:
        cells, own: change in the footprint's window, and the cells (rows, columns) of the zone.
    """
    known = np.isfinite(cells.dz) & footprint.inside
    depth = ndimage.distance_transform_edt(own) - ndimage.distance_transform_edt(~own)
    ring = np.ceil(_RINGS_A_CELL * (depth.max() - depth)).astype(np.int64)
    inside = np.where(known, ring, 0)
    number = np.bincount(inside[known])
    total = np.bincount(inside[known], cells.dz[known], minlength=len(number))
    reached = np.cumsum(number)
    middle = int(np.searchsorted(reached, _MIDDLE_SHARE * int(np.count_nonzero(own & known))))
    least = LEAST_SHARE * float(total[: middle + 1].sum()) / max(int(reached[middle]), 1)
    weak = np.flatnonzero((np.sign(least) * total < abs(least) * number) & (np.arange(len(number)) > middle))
    filled: Bool = footprint.inside & (ring < (int(weak[0]) if weak.size else len(number) + 1))
    return filled


def _sharp(found: _Found, track: Track, means: Float, kept: Sequence[KeptMoments], grid: Grid) -> Ground:
    """The ground by the motion of all surveys; as found where nothing in the zone moved by it."""
    largest = means[np.argmax(np.abs(means))]
    if largest == 0.0:
        return Ground(_flat(found.window, found.inside, grid))
    window, inner = _widened(found.window, found.footprint, grid)
    own, allowed = (np.zeros([s.stop - s.start for s in window], dtype=bool) for _ in range(2))
    row, column = np.divmod(track.footprint, grid.columns)
    here = (row >= window[0].start) & (row < window[0].stop)
    here &= (column >= window[1].start) & (column < window[1].stop)
    own[row[here] - window[0].start, column[here] - window[1].start] = True
    of_window, of_footprint = (
        tuple(slice(i.start - o.start, i.stop - o.start) for i, o in zip(inner, outer, strict=True))
        for outer in (window, found.window)
    )
    allowed[of_window] = found.footprint[of_footprint]
    sums = [_sums(one, window, kept[0].level) for one in kept]
    joint = joint_motion(sums, (means / largest).tolist(), own, grid.cell)
    inside = outlined(np.sign(largest) * joint.motion, joint.multiple, own, allowed)
    if not inside.any():
        return Ground(_flat(found.window, found.inside, grid))
    return Ground(_flat(window, inside, grid), *joint.of_surveys(inside))


def outlined(motion: Float, multiple: int, own: Bool, allowed: Bool) -> Bool:
    """The cells that moved by at least ``LEAST_SHARE`` of the most in the zone, connected with that place.

    Cells are in whole or not. There are as many as the area within the outline has, in the order of their motion.

    Args:
        motion: at the corners of cells as ``joint_motion`` gives it, positive where the zone moved.
        own, allowed: (rows, columns) cells of the zone, and those that may be its ground.
    """
    samples = max(2, _SAMPLES_A_CELL // multiple)
    rows, columns = (between(length, samples * multiple) for length in motion.shape)
    fine = (rows @ motion @ columns.T)[: own.shape[0] * samples, : own.shape[1] * samples]
    wide = np.ones((samples, samples), dtype=bool)
    most = float(np.max(fine, where=np.kron(own, wide), initial=0.0))
    if most <= 0.0:
        return np.zeros(own.shape, dtype=bool)
    parts, _ = ndimage.label((fine >= LEAST_SHARE * most) & np.kron(allowed, wide))
    whole = parts == parts.ravel()[int(np.argmax(np.where(np.kron(own & allowed, wide), fine, -np.inf)))]
    in_cells = (own.shape[0], samples, own.shape[1], samples)
    share, mean = (values.reshape(in_cells).mean(axis=(1, 3)) for values in (whole, fine))
    order = np.argsort(np.where(share > 0, -mean, np.inf), axis=None, kind="stable")
    inside = np.zeros(own.size, dtype=bool)
    inside[order[: round(float(share.sum()))]] = True
    return inside.reshape(own.shape)


def _widened(window: tuple[slice, ...], inside: Bool, grid: Grid) -> tuple[tuple[slice, ...], tuple[slice, ...]]:
    """The window of a footprint with ground around it, and the footprint's own, both within the grid."""
    wide, own = [], []
    for axis, (s, length) in enumerate(zip(window, grid.shape, strict=True)):
        taken = s.start + np.flatnonzero(inside.any(axis=1 - axis))
        low, high = int(taken[0]), int(taken[-1]) + 1
        margin = max(_MIN_MARGIN_CELLS, round(_MARGIN_SHARE * (high - low)))
        wide.append(slice(max(0, low - margin), min(length, high + margin)))
        own.append(slice(low, high))
    return tuple(wide), tuple(own)


def _sums(kept: KeptMoments, window: tuple[slice, ...], level: float) -> Float:
    """Of the cells in a window, (10, rows, columns)."""
    columns = kept.shape[1]
    first, last = np.searchsorted(kept.cell, [window[0].start * columns, window[0].stop * columns])
    row, column = np.divmod(kept.cell[first:last], columns)
    here = first + np.flatnonzero((column >= window[1].start) & (column < window[1].stop))
    part = KeptMoments(kept.cell[here], kept.sums[:, here], kept.shape, kept.level).from_level(level)
    sums = np.zeros((PLAIN_SUMS, *(s.stop - s.start for s in window)))
    row, column = np.divmod(part.cell, columns)
    sums[:, row - window[0].start, column - window[1].start] = part.sums[:PLAIN_SUMS]
    return sums
