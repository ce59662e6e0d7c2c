"""The summary of a change under the labels of the Geomorphic Change Detection software (GCD, Riverscapes Consortium).

Labels and definitions are GCD's: *raw* counts every compared cell, *thresholded* those beyond their level of detection.
Errors differ: GCD multiplies areas by errors of cells, here they are standard errors with correlated errors
(``volumes.CorrelationModel``). The last group, which GCD has not, holds the zones' volumes over their footprints.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from .outputs import atomic_output
from .volumes import Z95, Cells, CorrelationModel, ZoneVolumes

GROUPS = ("AREAL", "VOLUMETRIC", "VERTICAL AVERAGES", "PERCENTAGES (BY VOLUME)", "ZONES (OVER THEIR FOOTPRINTS)")


@dataclass(frozen=True)
class TableRow:
    """A line of the summary; None where GCD has no value either.

    Where nothing was summed up, ``thresholded`` is 0 and has no error.
    ``standard_error``, ``low_95`` and ``high_95`` (the 95 % interval) and ``error_percent`` belong to ``thresholded``,
    and ``raw_error`` to ``raw``.
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
    """Areas (m²) and volumes (m³) of the cells that sank and that rose, and the volumes' standard errors.

    ``net_error`` belongs to raising minus lowering, ``total_error`` to their sum.
    """

    area_lowering: float
    area_raising: float
    lowering: float
    raising: float
    lowering_error: float
    raising_error: float
    net_error: float
    total_error: float

    @property
    def total(self) -> float:
        return self.lowering + self.raising

    @property
    def net(self) -> float:
        return self.raising - self.lowering


@dataclass(frozen=True)
class VolumeTable:
    """Summary of one change. ``area`` is the compared area, m²; the zones' volumes are positive, with their errors."""

    area: float
    raw: Budget
    thresholded: Budget
    zones_lowering: tuple[float, float]
    zones_raising: tuple[float, float]
    zones_net: tuple[float, float]
    model: CorrelationModel

    def rows(self) -> tuple[TableRow, ...]:
        """The lines in GCD's order."""
        return (*_areas(self), *_volumes(self), *_averages(self), *_percentages(self), *_zones(self))

    def figures(self) -> dict[str, float]:
        """The zones' volumes with their errors, for the run record's metrics."""
        return {
            "vol_loss_m3": self.zones_lowering[0],
            "vol_loss_err_m3": self.zones_lowering[1],
            "vol_gain_m3": self.zones_raising[0],
            "vol_gain_err_m3": self.zones_raising[1],
            "vol_net_m3": self.zones_net[0],
            "vol_net_err_m3": self.zones_net[1],
        }

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
        raw=_budget(cells, known, model),
        thresholded=_budget(cells, known & significant, model),
        zones_lowering=(0.0 - zones.lowering[0], zones.lowering[1]),
        zones_raising=zones.raising,
        zones_net=zones.total,
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


def _budget(cells: Cells, chosen: NDArray[np.bool_], model: CorrelationModel) -> Budget:
    dz = np.where(chosen, cells.dz, 0.0)
    weights = np.where(chosen & (dz != 0), cells.area, 0.0)
    down, up = np.where(dz < 0, weights, 0.0), np.where(dz > 0, weights, 0.0)
    return Budget(
        area_lowering=float(down.sum()),
        area_raising=float(up.sum()),
        lowering=float(-np.sum(down * dz)),
        raising=float(np.sum(up * dz)),
        lowering_error=model.sum_error(down, cells),
        raising_error=model.sum_error(up, cells),
        # a cell that measured exactly nothing has an error too
        net_error=model.sum_error(np.where(chosen, cells.area, 0.0), cells),
        total_error=model.sum_error(up - down, cells),
    )


def _areas(table: VolumeTable) -> list[TableRow]:
    raw, kept = table.raw, table.thresholded
    detectable = kept.area_lowering + kept.area_raising
    group = GROUPS[0]
    return [
        TableRow(group, "Total Area of Surface Lowering", "m²", raw.area_lowering, thresholded=kept.area_lowering),
        TableRow(group, "Total Area of Surface Raising", "m²", raw.area_raising, thresholded=kept.area_raising),
        TableRow(group, "Total Area of Detectable Change", "m²", thresholded=detectable),
        TableRow(group, "Total Area of Interest", "m²", table.area),
        TableRow(
            group,
            "Percent of Area of Interest with Detectable Change",
            "%",
            thresholded=_percent(detectable, table.area),
        ),
    ]


def _volumes(table: VolumeTable) -> list[TableRow]:
    raw, kept = table.raw, table.thresholded
    group = GROUPS[1]
    return [
        _measured(group, "Total Volume of Surface Lowering", "m³", raw.lowering, kept.lowering, kept.lowering_error),
        _measured(group, "Total Volume of Surface Raising", "m³", raw.raising, kept.raising, kept.raising_error),
        _measured(group, "Total Volume of Difference", "m³", raw.total, kept.total, kept.total_error),
        _measured(
            group, "Total Net Volume Difference", "m³", raw.net, kept.net, kept.net_error, raw_error=raw.net_error
        ),
    ]


def _averages(table: VolumeTable) -> list[TableRow]:
    raw, kept = table.raw, table.thresholded
    group, thickness = GROUPS[2], "Average {}Thickness of Difference for Area {}"
    detectable = kept.area_lowering + kept.area_raising
    net = "Net "
    return [
        _measured(
            group,
            "Average Depth of Surface Lowering",
            "m",
            _ratio(raw.lowering, raw.area_lowering),
            _ratio(kept.lowering, kept.area_lowering),
            _ratio(kept.lowering_error, kept.area_lowering),
        ),
        _measured(
            group,
            "Average Depth of Surface Raising",
            "m",
            _ratio(raw.raising, raw.area_raising),
            _ratio(kept.raising, kept.area_raising),
            _ratio(kept.raising_error, kept.area_raising),
        ),
        _measured(
            group,
            thickness.format("Total ", "of Interest"),
            "m",
            _ratio(raw.total, table.area),
            _ratio(kept.total, table.area),
            _ratio(kept.total_error, table.area),
        ),
        _measured(
            group,
            thickness.format(net, "of Interest"),
            "m",
            _ratio(raw.net, table.area),
            _ratio(kept.net, table.area),
            _ratio(kept.net_error, table.area),
            raw_error=_ratio(raw.net_error, table.area),
        ),
        _measured(
            group,
            thickness.format("Total ", "with Detectable Change"),
            "m",
            None,
            _ratio(kept.total, detectable),
            _ratio(kept.total_error, detectable),
        ),
        _measured(
            group,
            thickness.format(net, "with Detectable Change"),
            "m",
            None,
            _ratio(kept.net, detectable),
            _ratio(kept.net_error, detectable),
        ),
    ]


def _percentages(table: VolumeTable) -> list[TableRow]:
    raw, kept = table.raw, table.thresholded

    def row(quantity: str, values: Sequence[float | None]) -> TableRow:
        return TableRow(GROUPS[3], quantity, "%", values[0], thresholded=values[1])

    return [
        row("Percent Elevation Lowering", [_percent(b.lowering, b.total) for b in (raw, kept)]),
        row("Percent Elevation Raising", [_percent(b.raising, b.total) for b in (raw, kept)]),
        row("Percent Imbalance (departure from equilibrium)", [_percent(b.net, 2 * b.total) for b in (raw, kept)]),
        row("Net to Total Volume Ratio", [_percent(b.net, b.total) for b in (raw, kept)]),
    ]


def _zones(table: VolumeTable) -> list[TableRow]:
    group = GROUPS[4]
    return [
        _measured(group, "Total Volume of Surface Lowering", "m³", None, *table.zones_lowering),
        _measured(group, "Total Volume of Surface Raising", "m³", None, *table.zones_raising),
        _measured(group, "Total Net Volume Difference", "m³", None, *table.zones_net),
    ]


def _measured(
    group: str,
    quantity: str,
    unit: str,
    raw: float | None,
    value: float | None,
    error: float | None,
    *,
    raw_error: float | None = None,
) -> TableRow:
    if value is None or error is None:
        return TableRow(group, quantity, unit, raw, raw_error)
    if value == 0 and error == 0:
        # nothing was summed up, of which there could be an error
        return TableRow(group, quantity, unit, raw, raw_error, 0.0)
    low, high = value - Z95 * error, value + Z95 * error
    percent = None if value == 0 else 100.0 * error / abs(value)
    return TableRow(group, quantity, unit, raw, raw_error, value, error, low, high, percent)


def _ratio(part: float, whole: float) -> float | None:
    return part / whole if whole else None


def _percent(part: float, whole: float) -> float | None:
    return 100.0 * part / whole if whole else None


def _rounded(value: Any) -> Any:
    return round(value, 6) + 0.0 if isinstance(value, float) else value  # + 0.0: no minus zero


def _text(value: Any) -> str:
    return "" if value is None else str(_rounded(value))
