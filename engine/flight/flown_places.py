"""What a flown survey has of what its plan promised, place by place."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from ..core.arrays import Bool, Float
from ..grid.grid import Grid, cell_index

SHORTFALL = 0.15
"""Share of the promised returns that a place must lack to have fallen short."""
_TOGETHER = np.ones((3, 3))
"""Places that are counted together: under plants the share of a single one depends on where the beams come from."""
_CHANCE = 2.0  # standard deviations of a count, as chance makes them, that it must lack as well
_MIN_BEYOND = 0.01  # share of the returns beyond the region; below it the cloud was cut to the region


@dataclass(frozen=True)
class Reached:
    """Densities (rows, columns) a m² of map, NaN outside of the plan's places.

    ``promised`` and ``reached``; ``whole`` is False where the cloud was cut along the region, and then ``judged`` is at
    its rim; ``short`` where of a place and the up to eight around it
    more than 15 % are missing, and more than two standard deviations of what chance makes.
    """

    promised: Float
    reached: Float
    judged: Bool
    short: Bool
    whole: bool

    @property
    def ratio(self) -> float:
        """Reached over promised, of all places that are judged."""
        total = float(np.nansum(self.promised[self.judged]))
        return float(np.nansum(self.reached[self.judged])) / total if total > 0 else float("nan")

    @property
    def short_share(self) -> float:
        return float(self.short.sum() / self.judged.sum()) if self.judged.any() else float("nan")


def counts_of(xy: Float, grid: Grid) -> tuple[Float, int]:
    """Points of each place (rows, columns), and how many lie beyond the grid."""
    place = cell_index(xy, grid)
    inside = place[place >= 0]
    counts = np.bincount(inside, minlength=grid.rows * grid.columns).reshape(grid.shape)
    return counts.astype(np.float64), len(xy) - len(inside)


def reached_of(xy: Float, promised: Float, grid: Grid) -> Reached:
    """Compare points (n, 2+) with the ``promised`` density (rows, columns), NaN outside of the places."""
    inside = np.isfinite(promised)
    counts, beyond = counts_of(xy, grid)
    beyond += int(counts[~inside].sum())
    judged = inside & (promised > 0)
    whole = beyond >= _MIN_BEYOND * max(len(xy), 1)
    if not whole:
        judged &= ndimage.binary_erosion(inside, np.ones((3, 3)))
    area = grid.cell**2
    wanted = np.where(inside, promised, 0.0) * area
    near, due = (ndimage.convolve(np.where(judged, a, 0.0), _TOGETHER, mode="constant") for a in (counts, wanted))
    short = judged & (near < (1 - SHORTFALL) * due) & (near < due - _CHANCE * np.sqrt(due))
    return Reached(promised, np.where(inside, counts / area, np.nan), judged, short, whole)
