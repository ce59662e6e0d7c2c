"""Change segregated by classes of asset, as GCD segregates a budget by a mask of polygons.

Every cell belongs to the class that holds its centre, or to none, so that the sums over the classes and what is in none
are those of the whole. Areas, volumes and thresholds are those of ``gcd_table``; GCD's error of a class is the
sum of its cells' errors, here it is a standard error with correlated errors (``volumes.CorrelationModel``).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from ..core.arrays import Float
from .footprints import Cells, in_window
from .volumes import CorrelationModel

NO_CLASS, WHOLE = "no class", "all"
"""Names of the rows of the cells in no class, and of all cells."""


@dataclass(frozen=True)
class ClassBudget:
    """The change of one class. Areas m², volumes m³, heights m; volumes are positive, ``net`` and means signed.

    Attributes:
        area: of the class's polygons; None for what is in no class, and for all.
        compared_area: of its cells with heights of both surveys; ``compared_share`` is its part of ``area`` in plan.
        lowering_area, raising_area: of its cells beyond their level of detection.
        lowering, raising: volumes of these; their errors are standard errors of the sums over just these cells.
        net: raising minus lowering.
        all_net: change of all its compared cells, whether beyond their level or not, in which noise cancels.
        mean: of the change of its compared cells.
        share: of the class in lowering plus raising of the whole.
    """

    name: str
    area: float | None
    compared_area: float
    compared_share: float | None
    lowering_area: float
    raising_area: float
    lowering: float
    lowering_error: float
    raising: float
    raising_error: float
    net: float
    net_error: float
    all_net: float
    all_net_error: float
    mean: float | None
    mean_error: float | None
    share: float | None

    def row(self) -> dict[str, Any]:
        """By the names of the table's columns."""
        return {_COLUMNS[name]: value for name, value in asdict(self).items()}


_COLUMNS = {
    "name": "class",
    "area": "area_m2",
    "compared_area": "compared_m2",
    "compared_share": "compared_share",
    "lowering_area": "lowering_m2",
    "raising_area": "raising_m2",
    "lowering": "vol_lowering_m3",
    "lowering_error": "vol_lowering_err_m3",
    "raising": "vol_raising_m3",
    "raising_error": "vol_raising_err_m3",
    "net": "vol_net_m3",
    "net_error": "vol_net_err_m3",
    "all_net": "all_net_m3",
    "all_net_error": "all_net_err_m3",
    "mean": "dz_mean_m",
    "mean_error": "dz_mean_err_m",
    "share": "share",
}
COLUMNS = tuple(_COLUMNS.values())


def class_budgets(
    cells: Cells,
    significant: NDArray[np.bool_],
    labels: NDArray[np.int32],
    classes: Sequence[tuple[str, float]],
    model: CorrelationModel,
) -> tuple[ClassBudget, ...]:
    """One row a class, then that of the cells in none, then that of all.

    Args:
        significant: as the arrays of ``cells``; cells beyond their level of detection.
        labels: (rows, columns) of the grid, 0 or 1 + the number of the class.
        classes: name and area (m²) of each.
    """
    held = cells.layout.of(labels)
    windows = ndimage.find_objects(labels, max_label=len(classes))
    moved = significant & np.isfinite(cells.dz)
    total = math.fsum(np.abs(cells.dz[moved]) * cells.area[moved])
    rows = []
    for number, ((name, area), window) in enumerate(zip(classes, windows, strict=True), 1):
        if window is None:
            rows.append(_budget(name, area, cells, np.zeros(held.shape, dtype=bool), moved, model, total))
            continue
        near = in_window(cells, window)
        beyond = cells.layout.window(moved, window)
        rows.append(_budget(name, area, near, labels[window] == number, beyond, model, total))
    rows.append(_budget(NO_CLASS, None, cells, held == 0, moved, model, total))
    rows.append(_budget(WHOLE, None, cells, np.ones(held.shape, dtype=bool), moved, model, total))
    return tuple(rows)


def _budget(
    name: str,
    area: float | None,
    cells: Cells,
    chosen: NDArray[np.bool_],
    moved: NDArray[np.bool_],
    model: CorrelationModel,
    total: float,
) -> ClassBudget:
    known = chosen & np.isfinite(cells.dz)
    dz = np.where(known, cells.dz, 0.0).astype(np.float64)
    weights = np.where(known, cells.area, 0.0).astype(np.float64)
    beyond = known & moved & (dz != 0)
    down, up = (np.where(beyond & side, weights, 0.0) for side in (dz < 0, dz > 0))
    lowering, raising = _total(-down * dz), _total(up * dz)
    compared = _total(weights)
    all_net, all_error = _total(weights * dz), _error(weights, cells, model, whole=True)
    share = None if not area else min(float(known.sum()) * cells.cell**2 / area, 1.0)
    return ClassBudget(
        name=name,
        area=area,
        compared_area=compared,
        compared_share=share,
        lowering_area=_total(down),
        raising_area=_total(up),
        lowering=lowering,
        lowering_error=_error(down, cells, model),
        raising=raising,
        raising_error=_error(up, cells, model),
        net=raising - lowering,
        net_error=_error(down + up, cells, model),
        all_net=all_net,
        all_net_error=all_error,
        mean=all_net / compared if compared else None,
        mean_error=all_error / compared if compared else None,
        share=(lowering + raising) / total if total else None,
    )


def _total(values: Float) -> float:
    """The sum to the last digit, whatever the order: parts add up to the whole."""
    return math.fsum(values[values != 0])


def _error(weights: Float, cells: Cells, model: CorrelationModel, *, whole: bool = False) -> float:
    if not weights.any():
        return 0.0
    # cells that were picked because they stand out have all of the plants' error, as zones have
    return model.whole_error(weights, cells) if whole else model.sum_error(weights, cells)
