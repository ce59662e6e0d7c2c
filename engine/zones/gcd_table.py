"""The summary of a change under the labels of the Geomorphic Change Detection software (GCD, Riverscapes Consortium).

Labels and definitions are GCD's: *raw* counts every compared cell, *thresholded* those beyond their level of detection.
Errors differ: GCD multiplies areas by errors of cells, here they are standard errors with correlated errors
(``volumes.CorrelationModel``). Sums of lowering and of raising have none: noise alone makes both, of raw cells as of
those beyond their level, and no interval around such a sum holds the truth. The raw net volume has one, in which noise
cancels, and so has the last group, which GCD has not: the zones' volumes over their footprints.
"""

from __future__ import annotations

import csv
import io
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from ..core.staged_outputs import atomic_output
from ..statistics.normal import Z95
from .footprints import Cells
from .volumes import CorrelationModel, ZoneVolumes

GROUPS = ("AREAL", "VOLUMETRIC", "VERTICAL AVERAGES", "PERCENTAGES (BY VOLUME)", "ZONES (OVER THEIR FOOTPRINTS)")
_THICKNESS = "Average {} Thickness of Difference for Area"


@dataclass(frozen=True)
class TableRow:
    """A line of the summary; None where GCD has no value either.

    Where nothing was summed up, ``thresholded`` is 0 and has no error.
    ``standard_error``, ``low_95`` and ``high_95`` (the 95 % interval) and ``error_percent`` belong to ``thresholded``,
    of the zones only, and ``raw_error`` to ``raw``, of the net volume only.
    """

    group: str
    quantity: str
    unit: str
    raw: float | None = None
    raw_error: float | None = None
    thresholded: float | None = None
    standard_error: float | None = None
    low_95: float | None = None
    high_95: float | None = None
    error_percent: float | None = None


@dataclass(frozen=True)
class Budget:
    """Areas (m²) and volumes (m³) of the cells that sank and that rose."""

    area_lowering: float
    area_raising: float
    lowering: float
    raising: float

    @property
    def area(self) -> float:
        return self.area_lowering + self.area_raising

    @property
    def total(self) -> float:
        return self.lowering + self.raising

    @property
    def net(self) -> float:
        return self.raising - self.lowering


@dataclass(frozen=True)
class VolumeTable:
    """Summary of one change. ``area`` is the compared area, m²; the zones' volumes are positive, with their errors.

    ``raw_net_error`` is the standard error of raising minus lowering of all compared cells, m³; ``zones_sliding`` the
    net volume of zones that slid, which is in none of the others, None without such zones.
    """

    area: float
    raw: Budget
    thresholded: Budget
    zones_lowering: tuple[float, float]
    zones_raising: tuple[float, float]
    zones_net: tuple[float, float]
    raw_net_error: float
    model: CorrelationModel
    zones_sliding: tuple[float, float] | None = None

    def rows(self) -> tuple[TableRow, ...]:
        """The lines in GCD's order."""
        return (*_gcd_rows(self), *(_zone_row(name, *values) for name, values in self._zones.items()))

    @property
    def _zones(self) -> dict[str, tuple[float, float]]:
        sliding = {} if self.zones_sliding is None else {"Net Volume Difference of Sliding Zones": self.zones_sliding}
        return {
            "Total Volume of Surface Lowering": self.zones_lowering,
            "Total Volume of Surface Raising": self.zones_raising,
            "Total Net Volume Difference": self.zones_net,
        } | sliding

    def figures(self) -> dict[str, float]:
        """The zones' volumes with their errors, for the run record's metrics."""
        return {
            "vol_loss_m3": self.zones_lowering[0],
            "vol_loss_err_m3": self.zones_lowering[1],
            "vol_gain_m3": self.zones_raising[0],
            "vol_gain_err_m3": self.zones_raising[1],
            "vol_net_m3": self.zones_net[0],
            "vol_net_err_m3": self.zones_net[1],
        } | (
            {}
            if self.zones_sliding is None
            else {"vol_sliding_net_m3": self.zones_sliding[0], "vol_sliding_net_err_m3": self.zones_sliding[1]}
        )

    def facts(self) -> dict[str, Any]:
        """For the run record."""
        return {"error_model": self.model.figures(), "rows": [asdict(row) for row in self.rows()]}


def volume_table(
    cells: Cells, significant: NDArray[np.bool_], zones: ZoneVolumes, model: CorrelationModel
) -> VolumeTable:
    """Sum up a change.

    Args:
        significant: (rows, columns), cells beyond their level of detection.
    """
    known = np.isfinite(cells.dz)
    return VolumeTable(
        area=float(cells.area[known].sum()),
        raw=_budget(cells, known),
        thresholded=_budget(cells, known & significant),
        zones_lowering=(0.0 - zones.lowering[0], zones.lowering[1]),
        zones_raising=zones.raising,
        zones_net=zones.total,
        zones_sliding=zones.sliding if any(zones.sliding) else None,
        # a cell that measured exactly nothing has an error too
        raw_net_error=model.whole_error(np.where(known, cells.area, 0.0), cells),
        model=model,
    )


def write_volume_table(path: Path, table: VolumeTable) -> None:
    """Write the lines as comma-separated values: UTF-8, a point before decimals, empty where there is no value."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    names = list(TableRow.__dataclass_fields__)
    writer.writerow(names)
    for row in table.rows():
        writer.writerow([_text(getattr(row, name)) for name in names])
    with atomic_output(path) as partial:
        partial.write_text(text.getvalue(), encoding="utf-8")


def table_frame(table: VolumeTable) -> pd.DataFrame:
    """The lines as a table without geometry."""
    return pd.DataFrame([{k: _rounded(v) for k, v in asdict(row).items()} for row in table.rows()])


def _budget(cells: Cells, chosen: NDArray[np.bool_]) -> Budget:
    dz = np.where(chosen, cells.dz, 0.0)
    weights = np.where(chosen & (dz != 0), cells.area, 0.0)
    down, up = np.where(dz < 0, weights, 0.0), np.where(dz > 0, weights, 0.0)
    return Budget(
        area_lowering=float(down.sum()),
        area_raising=float(up.sum()),
        lowering=float(-np.sum(down * dz)),
        raising=float(np.sum(up * dz)),
    )


def _gcd_rows(table: VolumeTable) -> list[TableRow]:
    raw, kept, area = table.raw, table.thresholded, table.area
    changed, error = kept.area, table.raw_net_error
    areas, volumes, averages, percentages, _ = GROUPS
    net_error = _ratio(error, area)
    # group, quantity, unit, raw, raw_error, thresholded
    lines: list[tuple[str, str, str, float | None, float | None, float | None]] = [
        (areas, "Total Area of Surface Lowering", "m²", raw.area_lowering, None, kept.area_lowering),
        (areas, "Total Area of Surface Raising", "m²", raw.area_raising, None, kept.area_raising),
        (areas, "Total Area of Detectable Change", "m²", None, None, changed),
        (areas, "Total Area of Interest", "m²", area, None, None),
        (areas, "Percent of Area of Interest with Detectable Change", "%", None, None, _percent(changed, area)),
        (volumes, "Total Volume of Surface Lowering", "m³", raw.lowering, None, kept.lowering),
        (volumes, "Total Volume of Surface Raising", "m³", raw.raising, None, kept.raising),
        (volumes, "Total Volume of Difference", "m³", raw.total, None, kept.total),
        (volumes, "Total Net Volume Difference", "m³", raw.net, error, kept.net),
    ]
    shares = (
        ("Average Depth of Surface Lowering", [_ratio(b.lowering, b.area_lowering) for b in (raw, kept)], None),
        ("Average Depth of Surface Raising", [_ratio(b.raising, b.area_raising) for b in (raw, kept)], None),
        (f"{_THICKNESS.format('Total')} of Interest", [_ratio(b.total, area) for b in (raw, kept)], None),
        (f"{_THICKNESS.format('Net')} of Interest", [_ratio(b.net, area) for b in (raw, kept)], net_error),
        (f"{_THICKNESS.format('Total')} with Detectable Change", [None, _ratio(kept.total, changed)], None),
        (f"{_THICKNESS.format('Net')} with Detectable Change", [None, _ratio(kept.net, changed)], None),
    )
    lines += [(averages, quantity, "m", of[0], error, of[1]) for quantity, of, error in shares]
    parts = (
        ("Percent Elevation Lowering", [_percent(b.lowering, b.total) for b in (raw, kept)]),
        ("Percent Elevation Raising", [_percent(b.raising, b.total) for b in (raw, kept)]),
        ("Percent Imbalance (departure from equilibrium)", [_percent(b.net, 2 * b.total) for b in (raw, kept)]),
        ("Net to Total Volume Ratio", [_percent(b.net, b.total) for b in (raw, kept)]),
    )
    lines += [(percentages, quantity, "%", of[0], None, of[1]) for quantity, of in parts]
    return [TableRow(*line) for line in lines]


def _zone_row(quantity: str, value: float, error: float) -> TableRow:
    if value == 0 and error == 0:
        # nothing was summed up, of which there could be an error
        return TableRow(GROUPS[4], quantity, "m³", thresholded=0.0)
    low, high = value - Z95 * error, value + Z95 * error
    percent = None if value == 0 else 100.0 * error / abs(value)
    return TableRow(GROUPS[4], quantity, "m³", None, None, value, error, low, high, percent)


def _ratio(part: float, whole: float) -> float | None:
    return part / whole if whole else None


def _percent(part: float, whole: float) -> float | None:
    return 100.0 * part / whole if whole else None


def _rounded(value: Any) -> Any:
    return round(value, 6) + 0.0 if isinstance(value, float) else value  # + 0.0: no minus zero


def _text(value: Any) -> str:
    return "" if value is None else str(_rounded(value))
