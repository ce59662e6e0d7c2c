"""Changes of drawn cells whose truth and errors are known."""

from __future__ import annotations

import numpy as np
from slopewatch.engine.change.result import Change
from slopewatch.engine.grid.grid import Grid
from slopewatch.engine.grid.partition import Partition


def drawn_change(
    dz: np.ndarray, sigma: float, cell: float, *, registration: float = 0.0, points: tuple[int, int] = (5, 5)
) -> Change:
    """A change ``dz`` (rows, columns; NaN: not measured) whose cells err by ``sigma``, metres, each for itself."""
    known = np.isfinite(dz)
    error = np.where(known, np.hypot(sigma, registration), np.nan)
    with np.errstate(invalid="ignore"):
        significant = np.abs(dz) > 1.96 * error
    counts = [np.where(known, n, 0) for n in points]
    return Change(
        grid=Grid(100.0, 100.0 + cell * dz.shape[0], cell, *dz.shape),
        partition=Partition(dz.shape, cell),
        dz=dz,
        error=error,
        level=1.96 * error,
        significant=significant,
        count_from=counts[0],
        count_to=counts[1],
        height_from=np.where(known, 0.0, np.nan),
        height_to=dz,
        confidence=0.95,
        registration_error=registration,
        common_cell_rate=float(known.mean()),
        uniform_dz=None,
        stable=known & ~significant,
        slope=np.where(known, 0.0, np.nan),
    )
