"""Statistics of the change between two elevation models, without zones."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..change.result import Change
from ..core.arrays import Float
from ..statistics.robust import nmad


def change_statistics(change: Change) -> dict[str, float | None]:
    """Of all compared cells (``dz_``) and of the stable ones (``stable_dz_``), metres, and shares of cells.

    Quantities that need a cell are None without one.
    """
    stable = change.stable & change.valid
    return {
        "compared_m2": float(change.valid.sum() * change.grid.cell**2),
        "level_median_m": change.median_level,
        "beyond_share": _share(change, change.valid),
        "stable_share": float(stable.sum() / max(int(change.valid.sum()), 1)),
        "stable_beyond_share": _share(change, stable),
        **_of_cells("dz", change.dz[change.valid]),
        **_of_cells("stable_dz", change.dz[stable]),
    }


def _share(change: Change, cells: Any) -> float | None:
    return float(change.significant[cells].mean()) if cells.any() else None


def _of_cells(name: str, dz: Float) -> dict[str, float | None]:
    if not dz.size:
        return {}
    low, high = np.quantile(dz, (0.05, 0.95)).tolist()
    found = {
        "mean": dz.mean(), "median": np.median(dz), "std": dz.std(), "nmad": nmad(dz),
        "rms": np.sqrt(np.mean(dz**2)), "min": dz.min(), "p05": low, "p95": high, "max": dz.max(),
    }  # fmt: skip
    return {f"{name}_{key}_m": float(value) for key, value in found.items()}
