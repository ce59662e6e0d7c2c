"""How the plants differ between two surveys, and which change they explain: mown grass is no hazard."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core.arrays import Float
from ..core.number_text import fixed
from ..grid.plant_cells import PlantCells
from ..pointcloud.plant_cover import MIN_HEIGHT_DIFFERENCE_M
from ..statistics.layout import Layout, layout_of
from ..statistics.normal import quantile
from ..statistics.robust import nmad
from ..statistics.window_sums import Windows
from .plant_calibration import MIN_PATCHES, squares_of

MIN_PLANT_HEIGHT_M = 0.05
"""Metres: ground over which returns lie so high at the median has plants."""
MAX_EXPLAINED_SHARE = 0.5
"""Share of a difference of plant heights that the ground under them can be wrong by at most, where a run shows no less.

The ground is at worst taken for the middle of the plants. On real grass of 0.2 to 0.3 m, lower envelopes lie 0.02 to
0.1 m too high.
"""
MARGIN_M = 1.0
"""Metres around plants within which the ground under thin ones can be taken for bare, and their height for nothing."""
MIN_COVERED_SHARE = 0.5
"""Share of the known ground within ``MARGIN_M`` that must have plants where the season is alike: a shrub that was
sampled otherwise is no evidence for the bare ground next to it."""
_MIN_CHANGED_SHARE = 0.5  # of the vegetated cells: where so many have changed alike, the season differs
_MIN_VEGETATED_CELLS = 30  # with fewer the season is not judged
_MIN_VEGETATED_SHARE = 0.02  # of the cells that must have plants


@dataclass(frozen=True)
class Season:
    """Plants of two surveys in the cells that both have; heights and changes in metres.

    Attributes:
        verdict: lower, higher, alike, or no plants (in the later survey against the first).
        cells: number of cells that have plants in either survey; ``share``: of all compared.
        height_from, height_to: median height of the plants in these cells.
        lower_share, higher_share: of these cells, where the plants stand lower, or higher, by more than 5 cm.
        dz_plants, dz_bare: median change of the cells with plants and of the others; None without such cells.
    """

    verdict: str
    cells: int
    share: float
    height_from: float
    height_to: float
    lower_share: float
    higher_share: float
    dz_plants: float | None
    dz_bare: float | None

    @property
    def differs(self) -> bool:
        return self.verdict in ("lower", "higher")

    def explains(self, shift: float) -> bool:
        """Whether a change of the whole surface by ``shift`` m has the sign and the size that the plants can cause."""
        risen = self.height_to - self.height_from
        return self.differs and shift * risen > 0 and abs(shift) <= abs(risen)

    @property
    def sentence(self) -> str:
        """For the user."""
        if self.verdict == "no plants":
            return "Hardly any of the compared ground had plants in either survey."
        heights = f"{self.height_from:.2f} m high in the first survey and {self.height_to:.2f} m in the second"
        stood = f"The plants stood {heights}"
        if not self.differs:
            return f"{stood}: the season is alike."
        lower = self.verdict == "lower"
        changed = self.lower_share if lower else self.higher_share
        least = f"{100 * MIN_HEIGHT_DIFFERENCE_M:.0f} cm"
        return (
            f"{stood} ({'lower' if lower else 'higher'} by more than {least} on {changed:.0%} of the "
            f"ground with plants): a small {'lowering' if lower else 'raising'} there may be the plants' and is not "
            f"reported as change of the ground{self._measured}; surveys of the same season compare better."
        )

    @property
    def _measured(self) -> str:
        if self.dz_plants is None:
            return ""
        bare = "" if self.dz_bare is None else f", bare ground by {fixed(self.dz_bare, 3, sign=True)} m"
        return f" (ground with plants changed by {fixed(self.dz_plants, 3, sign=True)} m at the median{bare})"

    def facts(self) -> dict[str, Any]:
        """For the run record."""
        return {
            "verdict": self.verdict,
            "sentence": self.sentence,
            "vegetated_cells": self.cells,
            "vegetated_share": self.share,
            "plant_height_from_m": self.height_from,
            "plant_height_to_m": self.height_to,
            "lower_share": self.lower_share,
            "higher_share": self.higher_share,
            "dz_median_plants_m": self.dz_plants,
            "dz_median_bare_m": self.dz_bare,
        }


def judge_season(
    plants: PlantCells | None, dz: Float, level: Float, cell: float, layout: Layout | None = None
) -> tuple[Season | None, NDArray[np.bool_] | None]:
    """How the plants of a change differ, and which cells they explain; None where that is not known.

    Args:
        dz, level: change and its level of detection, metres.
        cell: side of a cell, metres.
        layout: of the arrays; all cells (rows, columns) by default.
    """
    if plants is None or plants.height_from is None or plants.height_to is None:
        return None, None
    heights = plants.height_from, plants.height_to
    season = compare_seasons(*heights, dz)
    least = 0.0 if season is not None and season.differs else MIN_COVERED_SHARE
    near = around(*heights, cell, least, layout)
    share = explained_share(dz, *heights, squares_of(layout or layout_of(dz), cell))
    own, margin = (explained_by_plants(dz, level, *of, share) for of in (heights, near))
    return season, own | margin


def explained_share(dz: Float, height_from: Float, height_to: Float, square: NDArray[np.signedinteger[Any]]) -> float:
    """Share of a difference of plant heights by which the ground under them is wrong in this run, at most 0.5.

    Ground under plants that differ by more than 5 cm shows it: in each square of 2 m the change with the sign of that
    difference, over the difference. The share is the one that 95 % of the squares stay below, from their median and
    NMAD, so that ground that moved counts for little unless it is half of them. With fewer than 20 squares it is 0.5.

    Args:
        dz, height_from, height_to: change and heights of the plants, metres, of one shape; NaN where not known.
        square: number of the square of 2 m that each cell is in.
    """
    risen = height_to - height_from
    with np.errstate(invalid="ignore"):
        used = np.isfinite(dz) & (np.abs(risen) > MIN_HEIGHT_DIFFERENCE_M)
    _, place = np.unique(square[used], return_inverse=True)
    count = np.bincount(place)
    if count.size < MIN_PATCHES:
        return MAX_EXPLAINED_SHARE
    shares = np.bincount(place, (dz * np.sign(risen))[used]) / np.bincount(place, np.abs(risen)[used])
    middle = float(np.median(shares))
    return float(np.clip(middle + quantile(0.9) * nmad(shares, middle), 0.0, MAX_EXPLAINED_SHARE))


def around(
    height_from: Float, height_to: Float, cell: float, least_share: float = 0.0, layout: Layout | None = None
) -> tuple[Float, Float]:
    """Mean heights of both surveys over the cells with plants within ``MARGIN_M``.

    Where grass thins out, its lowest returns scatter as those of bare ground do: the ground comes out within the plants
    and these as nothing. The plants around show better how they have changed. NaN where no plants stand, or on less
    than ``least_share`` of the known ground.

    Args:
        height_from, height_to: heights of the plants in each cell, metres, NaN where not known.
        cell: side of a cell, metres.
        layout: of the arrays; all cells (rows, columns) by default.
    """
    layout = layout or layout_of(height_from)
    known = np.isfinite(height_from + height_to)
    with np.errstate(invalid="ignore"):
        grown = known & (np.maximum(height_from, height_to) >= MIN_PLANT_HEIGHT_M)
    every = layout.flat(np.arange(grown.size))
    windows = Windows(every, layout.shape, round(MARGIN_M / cell))
    of_plants, of_known = np.flatnonzero(grown), np.flatnonzero(known)
    (ground,) = windows.totals(every[of_known], np.ones(of_known.size, dtype=np.int32))
    heights = (height.ravel()[of_plants] for height in (height_from, height_to))
    number, *sums = windows.totals(every[of_plants], np.ones(of_plants.size, dtype=np.int32), *heights)
    enough = (number > 0) & (number >= least_share * ground - 1e-9)
    count = np.where(enough, number, np.nan)
    first, second = ((total / count).reshape(grown.shape) for total in sums)
    return first, second


def compare_seasons(height_from: Float, height_to: Float, dz: Float | None = None) -> Season | None:
    """How the plants of two surveys differ; None where no cell is known of both.

    Args:
        height_from, height_to: heights of the plants in each cell, any shape, metres; NaN where not known.
        dz: change of the ground, metres, NaN where it was not compared; such cells are left out.
    """
    known = np.isfinite(height_from) & np.isfinite(height_to)
    if dz is not None:
        known &= np.isfinite(dz)
    if not known.any():
        return None
    first, second = height_from[known], height_to[known]
    plants = np.maximum(first, second) >= MIN_PLANT_HEIGHT_M
    cells, share = int(plants.sum()), float(plants.mean())

    def median(values: Float) -> float | None:
        return float(np.median(values)) if values.size else None

    heights = median(first[plants]) or 0.0, median(second[plants]) or 0.0
    risen = second[plants] - first[plants]
    lower, higher = (float(np.mean(sign * risen > MIN_HEIGHT_DIFFERENCE_M)) if cells else 0.0 for sign in (-1, 1))
    verdict = "alike"
    if cells < _MIN_VEGETATED_CELLS or share < _MIN_VEGETATED_SHARE:
        verdict = "no plants"
    elif max(lower, higher) >= _MIN_CHANGED_SHARE:
        verdict = "lower" if lower > higher else "higher"
    moved = None if dz is None else dz[known]
    return Season(
        verdict=verdict,
        cells=cells,
        share=share,
        height_from=heights[0],
        height_to=heights[1],
        lower_share=lower,
        higher_share=higher,
        dz_plants=None if moved is None else median(moved[plants]),
        dz_bare=None if moved is None else median(moved[~plants]),
    )


def explained_by_plants(
    dz: Float, level: Float, height_from: Float, height_to: Float, share: float = MAX_EXPLAINED_SHARE
) -> NDArray[np.bool_]:
    """Cells whose change may be the plants' alone; arrays of one shape, metres.

    Ground under plants comes out too high, the more so the higher they stand. So where the plants are lower than
    before, a lowering of the ground may be theirs, and where they are higher, a raising. A change is explained
    where the plants differ by more than 5 cm, it has that sign, and it is at most ``share`` of that difference and the
    cell's own level of detection, which the measurement can add to it. A change that is larger is one of the
    ground, whatever grew on it.
    """
    with np.errstate(invalid="ignore"):
        risen = height_to - height_from
        alike = (np.abs(risen) > MIN_HEIGHT_DIFFERENCE_M) & (dz * risen > 0)
        return np.asarray(alike & (np.abs(dz) <= share * np.abs(risen) + level))
