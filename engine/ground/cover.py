"""What covers the ground: bare, grass, shrubs, trees; and how well the ground below is known.

Squares seen from above (``cover_squares``) are classified by the heights of their returns over the extracted ground.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from ..core.arrays import Bool, Float
from .cover_squares import CLASS_HEIGHTS_M, CoverCells, OverGround, cover_cells, square_sums

BARE, LOW, SHRUBS, TREES, UNKNOWN = "bare", "low_plants", "shrubs", "trees", "unknown"
CLASSES = {
    BARE: "bare ground",
    LOW: "grass and low plants",
    SHRUBS: "shrubs and ferns",
    TREES: "trees",
    UNKNOWN: "no ground known",
}
_MAX_HIGHER_SHARE = 0.05  # share of a square's returns that may lie above a limit: a wire or a bird makes no tree
_MAX_BARE_ERROR_M = 0.01  # largest plant error (m) of bare ground: short closed grass has no return above 0.1 m
_MIN_WARNED_ERROR_M = 0.005  # plant errors (m) below it cause no warning
_MIN_WARNED_SHARE = 0.25
_MIN_DIP_COSINE = 0.1  # least cosine of the dip
_BIN_M, _LOWEST_M, _BINS = 0.05, -0.5, 70


@dataclass(frozen=True)
class CoverClass:
    """One class of cover. Shares are 0 to 1, lengths metres; NaN where not known.

    ``area_share`` of the surveyed area; ``returns`` in it; ``ground_share`` of these; ``without_ground_share`` of the
    class's area whose squares have no ground return; ``error_m`` the plant error, ``plant_height_m`` the height of the
    lowest layer, each the median over the area.
    """

    name: str
    area_share: float
    returns: int
    ground_share: float
    without_ground_share: float
    error_m: float
    plant_height_m: float


@dataclass(frozen=True)
class HeightCounts:
    """Returns by their height over the ground, in bins of ``bin_m`` from ``from_m`` on; all, and those of the ground.

    ``below`` and ``above`` lie outside of the bins; ``unknown`` have no height.
    """

    from_m: float
    bin_m: float
    returns: tuple[int, ...]
    ground: tuple[int, ...]
    below: int
    above: int
    unknown: int


@dataclass(frozen=True)
class GroundCover:
    """Cover of a survey. Areas are of what holds returns; shares are 0 to 1, lengths metres, NaN where unknown.

    ``ground_share`` of all returns; ``without_ground_share`` of the area; ``error_m`` and ``noise_m``: the error of the
    ground by plants, and the standard error of a square's mean by the scatter of its ground returns, medians over the
    area; ``error_beyond_noise_share`` of the area, where the former is larger than the latter and than 5 mm.
    """

    returns: int
    area_m2: float
    finest_m: float
    coarsest_m: float
    ground_share: float
    without_ground_share: float
    error_m: float
    noise_m: float
    error_beyond_noise_share: float
    classes: tuple[CoverClass, ...]
    heights: HeightCounts

    def figures(self) -> dict[str, float]:
        """The main numbers by name, for the figures of a run."""
        return {"without_ground_share": self.without_ground_share, "plant_error_m": self.error_m}


def cover_facts(
    xyz: Float,
    ground: Bool,
    height: Float,
    plant_error: Float | None = None,
    plant_height: Float | None = None,
    *,
    dip: float = 0.0,
) -> GroundCover:
    """Cover classes of a cloud whose ground was extracted.

    A square is of the highest class of which more than 5 % of its returns are; bare without such, unless plants make
    an error of more than 1 cm. It has no ground known where more than half of its returns have no height.

    Args:
        xyz: (n, 3) metres, n > 0.
        ground: (n,) which points are ground.
        height: (n,) height over the ground's surface, metres; NaN where no surface is known.
        plant_error: (n,) standard error of the ground there by plants, metres; 0 on bare ground, NaN unknown.
        plant_height: (n,) median height of the lowest layer around, metres.
        dip: angle of the slope's plane to the horizontal, degrees. The limits of the classes hold square to the slope,
            as on a steep face even the scatter of bare ground is large in the vertical.
    """
    upright = height * max(math.cos(math.radians(dip)), _MIN_DIP_COSINE)
    cells = cover_cells(xyz)
    over = OverGround(ground, height, upright, plant_error, plant_height)
    sums = square_sums(cells.index, len(cells.side), over)
    return facts_of_squares(cells, sums, height_counts(height, ground))


def facts_of_squares(cells: CoverCells, sums: Float, heights: HeightCounts) -> GroundCover:
    """``cover_facts`` from sums (SUMS, m) over the points of each square."""
    returns, on_ground, known, *plant_sums = sums[:7]
    error, plants = (_means(number, total) for number, total in (plant_sums[:2], plant_sums[2:]))
    count = int(returns.sum())
    # the highest class last: it takes what the lower ones took
    kinds = np.zeros(len(cells.side), dtype=np.int64)
    kinds[error > _MAX_BARE_ERROR_M] = 1
    for kind, higher in enumerate(sums[10:], 1):
        kinds[higher > _MAX_HIGHER_SHARE * known] = kind
    kinds[2 * known < returns] = len(CLASS_HEIGHTS_M) + 1
    area = cells.area
    noise = _noise(sums[7], sums[8], sums[9], on_ground)
    classes = []
    for kind, name in enumerate(CLASSES):
        chosen = kinds == kind
        inside = int(returns[chosen].sum())
        classes.append(
            CoverClass(
                name=name,
                area_share=float(area[chosen].sum() / area.sum()),
                returns=inside,
                ground_share=_share(on_ground[chosen].sum(), inside),
                without_ground_share=_share(area[chosen & (on_ground == 0)].sum(), area[chosen].sum()),
                error_m=_median(error[chosen], area[chosen]),
                plant_height_m=_median(plants[chosen], area[chosen]),
            )
        )
    middle = _median(noise, area)
    compared = np.where(np.isfinite(noise), noise, 0.0 if math.isnan(middle) else middle)
    beyond = error > np.maximum(compared, _MIN_WARNED_ERROR_M)
    return GroundCover(
        returns=count,
        area_m2=float(area.sum()),
        finest_m=float(cells.side.min()),
        coarsest_m=float(cells.side.max()),
        ground_share=float(on_ground.sum() / count),
        without_ground_share=float(area[on_ground == 0].sum() / area.sum()),
        error_m=_median(error, area),
        noise_m=middle,
        error_beyond_noise_share=float(area[beyond].sum() / area.sum()),
        classes=tuple(classes),
        heights=heights,
    )


def cover_table(cover: GroundCover) -> list[str]:
    """The classes as lines of a table for a terminal; classes without area are left out."""
    lines = [f"{'cover':<21}{'slope':>8}{'returns':>12}{'ground':>9}{'no ground':>11}{'error':>9}"]
    for row in cover.classes:
        if row.area_share > 0:
            error = f"{100 * row.error_m:.1f} cm" if math.isfinite(row.error_m) else "–"
            lines.append(
                f"{CLASSES[row.name]:<21}{percent(row.area_share):>8}{row.returns:>12,}{percent(row.ground_share):>9}"
                f"{percent(row.without_ground_share):>11}{error:>9}"
            )
    return lines


def cover_warnings(cover: GroundCover, name: str) -> list[str]:
    """Sentences where much of the survey ``name`` has no ground, or plants decide how well it is known."""
    found = []
    if cover.without_ground_share > _MIN_WARNED_SHARE:
        found.append(
            f"{percent(cover.without_ground_share)} of the area of {name} has no ground return, so little is known "
            "of it; a survey with leaves off, after mowing or before growth in spring sees more ground."
        )
    if cover.error_beyond_noise_share > _MIN_WARNED_SHARE:
        found.append(
            f"Vegetation on {name} makes a larger error of the ground's height than the noise of the returns (medians "
            f"{100 * cover.error_m:.1f} and {100 * cover.noise_m:.1f} cm over the whole area); survey with leaves off, "
            "mown or before growth, and always in the same state of the vegetation."
        )
    return found


def percent(share: float) -> str:
    """A share as a percentage, with a decimal where it is small; a dash where it is not known."""
    if not math.isfinite(share):
        return "–"
    return f"{100 * share:.{1 if 0 < share < 0.0995 else 0}f} %"


def _means(number: Float, total: Float) -> Float:
    """(m,) mean of the points' known values in each square; NaN without any."""
    return np.where(number > 0, total / np.maximum(number, 1), np.nan)


def _noise(number: Float, total: Float, squares: Float, on_ground: Float) -> Float:
    """(m,) standard error of the mean height of each square's ground returns; NaN for fewer than three."""
    enough = np.maximum(number, 2)
    variance = np.maximum(squares - total**2 / enough, 0.0) / (enough - 1)
    return np.where((number >= 3) & (on_ground >= 3), np.sqrt(variance / enough), np.nan)


def height_counts(height: Float, ground: Bool) -> HeightCounts:
    """Points (n,) by their height over the ground, m, all and those of the ground."""
    # bins that are whole numbers, because a comparison with edges takes much longer
    place = np.floor((height - _LOWEST_M) / _BIN_M)
    known = np.isfinite(height)
    inside = known & (place >= 0) & (place < _BINS)
    returns, on_ground = (
        np.bincount(place[chosen].astype(np.int64), minlength=_BINS).tolist() for chosen in (inside, inside & ground)
    )
    return HeightCounts(
        from_m=_LOWEST_M,
        bin_m=_BIN_M,
        returns=tuple(returns),
        ground=tuple(on_ground),
        below=int(np.count_nonzero(known & (place < 0))),
        above=int(np.count_nonzero(known & (place >= _BINS))),
        unknown=int(np.count_nonzero(~known)),
    )


def with_more(counts: HeightCounts, more: HeightCounts) -> HeightCounts:
    """The counts of both."""
    returns, ground = (
        tuple(a + b for a, b in zip(getattr(counts, name), getattr(more, name), strict=True))
        for name in ("returns", "ground")
    )
    below, above, unknown = (getattr(counts, name) + getattr(more, name) for name in ("below", "above", "unknown"))
    return replace(counts, returns=returns, ground=ground, below=below, above=above, unknown=unknown)


def _median(values: Float, weight: Float) -> float:
    """The known value below which half of the known values' weight lies; NaN without any."""
    known = np.isfinite(values)
    if not known.any():
        return math.nan
    order = np.argsort(values[known], kind="stable")
    sums = np.cumsum(weight[known][order])
    return float(values[known][order][np.searchsorted(sums, 0.5 * sums[-1])])


def _share(part: float, whole: float) -> float:
    return float(part / whole) if whole else math.nan
