"""Whether a correction of strips is worth it: decided on ground that it was not fitted to."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ...core.arrays import Float, Index
from ...geometry.voxels import block_numbers
from ...statistics.robust import nmad
from .model import LEVELS, StripModel, StripTimes, fitted
from .overlaps import Overlaps

_FOLDS = 5
BLOCK_CELLS = 6
"""Cells along the side of a block, which is held out as a whole: what neighbours have in common is no proof."""
MIN_BLOCKS = 15
_MIN_CELLS = 60
_MIN_GAIN_M, _MIN_STEP_M = 0.005, 0.002
"""By which the disagreement has to fall at least in all, as less is not worth moving points for, and by each model."""
_MIN_GAIN_ERRORS = 3.0
"""Standard errors of the gain on held-out blocks by which it has to differ from 0."""
_MAX_MOVED = 1.5
"""Root mean square by which ground may be raised or lowered, by that of the disagreement: what goes beyond it moves
strips together, which no overlap sees."""


@dataclass(frozen=True)
class StripFit:
    """How the strips of one survey fit, metres.

    Attributes:
        strips: as the file numbers them, and ``points`` of each.
        cells: cells with two strips or more.
        before: root mean square of the blocks' disagreement: the height of one strip over another in its middle.
        after: the same less a correction that was fitted without the block; ``before`` where none is accepted.
        gain_error: standard error of the difference of both.
        level: of ``model.LEVELS``; empty where no correction is accepted.
        model: what is taken off; None where none is accepted.
    """

    strips: tuple[int, ...]
    points: tuple[int, ...]
    cells: int
    before: float
    after: float
    gain_error: float
    level: str
    model: StripModel | None

    def facts(self) -> dict[str, Any]:
        """For the run record."""
        moved = self.model
        return {
            "strips": list(self.strips),
            "strip_points": list(self.points),
            "overlap_cells": self.cells,
            "disagreement_before_m": self.before,
            "disagreement_after_m": self.after,
            "gain_error_m": self.gain_error,
            "correction": self.level or "none",
            "shifts_m": None if moved is None else (-moved.shift).tolist(),
            "shift_errors_m": None if moved is None else moved.error.tolist(),
            "drift_m": None if moved is None else (-moved.drift).tolist(),
        }


@dataclass(frozen=True)
class _Blocks:
    """Number of the block (n,) and of the pair of strips (n,) of each cell, and the fold of each block (k,)."""

    number: Index
    couple: Index
    count: int
    fold: Index

    def means(self, values: Float, weight: Float) -> Float:
        """Robust means (k,) of ``values`` (n,)."""
        total = np.bincount(self.number, weight, self.count)
        return np.asarray(np.bincount(self.number, weight * values, self.count) / np.maximum(total, 1e-300))


def judged(pairs: Overlaps, cell: float, names: tuple[int, ...], points: Float, times: StripTimes) -> StripFit | None:
    """The plainest correction that clearly lowers the disagreement on held-out blocks; None with too little overlap."""
    blocks = _blocks(pairs, cell)
    if blocks is None:
        return None
    kept = blocks.number >= 0
    pairs, couple = pairs.chosen(kept), np.unique(blocks.couple[kept], return_inverse=True)[1]
    blocks = _Blocks(blocks.number[kept], couple, blocks.count, blocks.fold)
    weight = 1.0 / (pairs.variance + float(np.median(pairs.variance)))
    left = _clipped(pairs.height, blocks, weight)
    before = best = left
    level = ""
    for name in LEVELS:
        explained = np.zeros(len(pairs))
        for fold in range(_FOLDS):
            out = blocks.fold[blocks.number] == fold
            model = fitted(pairs.chosen(~out), name, points, times)
            explained[out] = model.differences(pairs.chosen(out))
        after = _clipped(pairs.height - explained, blocks, weight)
        gain, error = _gain(best, after)
        moved = _rms(fitted(pairs, name, points, times).heights(pairs))
        if gain > max(_MIN_STEP_M, _MIN_GAIN_ERRORS * error) and moved < _MAX_MOVED * _rms(before):
            best, level = after, name
    gain, gain_error = _gain(before, best)
    if gain < _MIN_GAIN_M:
        best, level, gain_error = before, "", 0.0
    return StripFit(
        names,
        tuple(int(n) for n in points),
        len(pairs),
        _rms(before),
        _rms(best),
        gain_error,
        level,
        fitted(pairs, level, points, times) if level else None,
    )


def _blocks(pairs: Overlaps, cell: float) -> _Blocks | None:
    """Blocks of BLOCK_CELLS cells and of one pair of strips; -1 for cells of blocks that hold too few."""
    if len(pairs) < _MIN_CELLS:
        return None
    flat = np.column_stack([pairs.place, np.zeros(len(pairs))])
    place = block_numbers(flat, BLOCK_CELLS * cell)
    couple = pairs.first * (int(pairs.second.max()) + 1) + pairs.second
    _, number = np.unique(np.column_stack([place, couple]), axis=0, return_inverse=True)
    number = number.ravel()
    held = np.bincount(number)
    enough = held >= 3
    if enough.sum() < MIN_BLOCKS:
        return None
    renumbered = np.where(enough, np.cumsum(enough) - 1, -1)
    of_place = np.zeros(len(held), dtype=np.int64)
    of_place[number] = place
    # One fold for all pairs over one place, for they share its ground.
    return _Blocks(renumbered[number], couple, int(enough.sum()), of_place[enough] % _FOLDS)


def _clipped(left: Float, blocks: _Blocks, weight: Float) -> Float:
    """(k,) mean of each block's cells, of which outliers count as far as they are usual between the same strips."""
    middle = np.array([np.median(left[blocks.couple == pair]) for pair in range(blocks.couple.max() + 1)])[
        blocks.couple
    ]
    spread = 3.0 * max(nmad(left - middle, 0.0), 1e-4)
    return blocks.means(np.clip(left, middle - spread, middle + spread), weight)


def _gain(before: Float, after: Float) -> tuple[float, float]:
    """By which the root mean square falls, and its standard error by the blocks (jackknife)."""
    n = len(before)
    one, two = before**2, after**2
    kept = np.sqrt((one.sum() - one) / (n - 1)) - np.sqrt((two.sum() - two) / (n - 1))
    error = float(np.sqrt((n - 1) / n * ((kept - kept.mean()) ** 2).sum()))
    return _rms(before) - _rms(after), error


def _rms(values: Float) -> float:
    return float(np.sqrt(np.mean(values**2)))
