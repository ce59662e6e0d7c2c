"""A70: how high a hazard must be so that 70 % of its kind are found, from place to place, by the slope's own ground.

A hazard is found by the matched filter where its even t score (``even_scores``) passes the level for the accepted false
zones. What a height must be to reach it is the level times the bump's standard error times the scatter of t about the
place: they hold density, noise and relief. This times a factor for what a zone of 1 m² must reach at hazards that are
not quite the bump is the height at which 70 % were found (docs/screening.md; ``benchmarks.screening_sites`` measures
it).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import median_filter

from ...engine.core.arrays import Float32
from .bump_filter import BumpFit
from .even_scores import even_t, level_for
from .raster_zones import Scores
from .relief_raster import ReliefRaster

FACTORS = {2.0: 3.0, 3.0: 1.25, 5.0: 1.25, 8.0: 1.15}
"""Height over (level times standard error times scatter) at which 70 % of the hazards of a diameter (m) were found;
between these diameters it is interpolated."""
RELIEF_FACTORS = {2.0: 0.87, 3.0: 1.12, 5.0: 0.75, 8.0: 0.53}
"""The same of the network on rasters of relief, as parts of the filter's: where a logistic fit of what was found over
the height finds 70 % (``benchmarks.screening_sites``, 42 places of real clouds and simulated slopes)."""
NETWORK_FACTORS = {2.0: 5.3, 3.0: 6.4, 5.0: 1.34, 8.0: 0.89}
"""The same of the network on points. At 2 and 3 m it is an extrapolation: hazards so narrow are hardly found more often
where they are higher (42 places; on simulated slopes alone 2.9, 1.5, 0.66, 0.60)."""
_SMOOTH_CELLS = 5
"""Standard errors are the median of squares of so many cells a side."""


@dataclass(frozen=True)
class SmallestHazard:
    """Heights (m) that hazards of ``diameters`` need to be found at 70 %: ``heights`` (diameters, columns, rows), NaN
    without data. ``level`` is that of the even t scores.
    """

    diameters: tuple[float, ...]
    heights: Float32
    level: float

    def at(self, column: int, row: int, diameter: float) -> float:
        """Height (m) that a hazard of ``diameter`` (m) needs at a cell; NaN where no such bump was fitted."""
        values = self.heights[:, column, row]
        after = int(np.clip(np.searchsorted(self.diameters, diameter), 1, len(self.diameters) - 1))
        narrow, wide = self.diameters[after - 1], self.diameters[after]
        share = min(max((diameter - narrow) / (wide - narrow), 0.0), 1.0)
        if share in (0.0, 1.0):
            return float(values[after - 1 + int(share)])
        return float((1.0 - share) * values[after - 1] + share * values[after])

    def share_below(self, height: float, diameter: float) -> float:
        """Part (0 to 1) of the slope on which a hazard of ``height`` m and one of the ``diameters`` can be found."""
        needed = self.heights[self.diameters.index(diameter)]
        covered = np.isfinite(self.heights).any(axis=0)
        return float(np.mean(needed[covered] <= height)) if covered.any() else 0.0


def filter_scores(raster: ReliefRaster) -> Scores:
    """For either sign the largest t score of all bumps; NaN where none could be fitted."""
    return Scores.strongest([fit.t for fit in raster.bumps], raster.cell)


def smallest_hazard(
    raster: ReliefRaster, false_zones: float = 1.0, parts: Mapping[float, float] | None = None
) -> SmallestHazard:
    """The map of A70 of a slope at the level of even scores for ``false_zones`` false zones per 1,000 m².

    Args:
        parts: by diameter (m), what another method needs as a part of what the filter does; linear in between.
    """
    level = level_for(false_zones)
    heights = np.stack([_needed(fit, level, raster.cell) * _between(parts, fit.diameter) for fit in raster.bumps])
    return SmallestHazard(tuple(fit.diameter for fit in raster.bumps), heights.astype(np.float32), level)


def _needed(fit: BumpFit, level: float, cell: float) -> Float32:
    known = np.isfinite(fit.error)
    if not known.any():
        return fit.error
    error = fit.error * even_t(fit, cell)[1]
    filled = np.where(known, error, np.median(error[known]))
    return np.where(
        known, _between(FACTORS, fit.diameter) * level * median_filter(filled, _SMOOTH_CELLS), np.nan
    ).astype(np.float32)


def _between(factors: Mapping[float, float] | None, diameter: float) -> float:
    return 1.0 if factors is None else float(np.interp(diameter, list(factors), list(factors.values())))
