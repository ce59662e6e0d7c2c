"""t scores that mean the same on every slope, and the level of them for a number of false zones.

The standard error of a bump takes the cells for independent. They are not: relief goes on from cell to cell, and the
more points there are, the less noise hides that. So t scatters by 1 on sparse ground and by 2 on dense one. Divided by
its own robust scatter within some 12 m it scatters by 1 everywhere, and one level holds on all slopes: on the
surveys of ``benchmarks.screening_sites``, each left out in turn, 0.2 to 2.0 false zones per 1,000 m² where 1 is asked
for, against 0 to 4.7 of t as it is (docs/screening.md).
"""

from __future__ import annotations

import numpy as np

from ...engine.core.arrays import Float, Float32
from .bump_filter import BumpFit
from .raster_zones import Scores, level_between
from .relief_raster import ReliefRaster, local_scatter

SCATTER_REACH_M = 12.0
"""Standard deviation of the Gaussian in which the scatter of t is taken."""
LEVELS = {0.1: 7.7, 0.2: 6.69, 0.3: 6.14, 0.5: 5.62, 1.0: 4.64, 2.0: 3.92, 3.0: 3.66, 5.0: 3.33, 10.0: 2.91}
"""Level for accepted false zones per 1,000 m², by conformal risk control (Angelopoulos et al., arXiv 2208.02814; for
segmentation arXiv 2504.07611) on 25 places, 16 of 7 real surveys and 9 simulated slopes: on a further slope drawn like
these the expected false zones per 1,000 m², counted up to 3 or twice the accepted number, are not more than accepted.
Below 0.2 so few places guarantee nothing; the level is continued there. ``benchmarks.screening_sites`` measures it."""


def even_t(fit: BumpFit, cell: float) -> tuple[Float32, Float]:
    """t score of a bump over its own scatter about each cell, and that scatter, both (columns, rows); ``cell`` in m."""
    scatter = np.maximum(local_scatter(fit.t.astype(np.float64), SCATTER_REACH_M / cell), 1e-3)
    return (fit.t / scatter).astype(np.float32), scatter


def even_scores(raster: ReliefRaster) -> Scores:
    """For either sign the largest even t score of all bumps; NaN where none could be fitted."""
    return Scores.strongest([even_t(fit, raster.cell)[0] for fit in raster.bumps], raster.cell)


def level_for(false_zones: float) -> float:
    """The level of even scores for accepted false zones per 1,000 m² (0.1 to 10)."""
    return level_between(LEVELS, false_zones)
