"""What a change between elevation models has in addition to the products of a change: significance, pairs, rates."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import zip_longest
from pathlib import Path
from typing import Any

import numpy as np
from pyproj import CRS

from ...engine.change.result import Change
from ...engine.core.staged_outputs import atomic_output
from ...engine.core.table_text import cell as table_cell
from ...engine.core.version import VERSION
from ...engine.elevation_models.comparison import ModelChange
from ...engine.elevation_models.rates import cell_rates
from ...engine.elevation_models.sentences import coregistration_facts, trend_facts
from ...engine.elevation_models.statistics import change_statistics
from ...engine.epochs.epoch import Epoch
from ...engine.grid import geotiff
from ...engine.maps import palette, qgis_styles
from ...engine.statistics.normal import Z95
from ...engine.zones.change_zones import cells_of, change_zones
from ...engine.zones.extraction import Zones
from ...engine.zones.footprints import in_window
from ...engine.zones.gcd_table import volume_table
from ...engine.zones.volumes import fit_correlation, zone_volumes
from ..run import Run
from .change import Context
from .classes import Compared, write_class_budgets
from .masked_raster import Legend, write_masked_raster

DEM_OUTPUTS = ("significance.tif", "pairs.csv", "zone_series.csv", "rate.tif")
_SIGNIFICANCE_LIMIT = 4.0  # standard errors at the end of the colours


@dataclass(frozen=True)
class Pair:
    """Two of the models, by their indices and as epochs, their reference system and their change."""

    indices: tuple[int, int]
    first: Epoch
    second: Epoch
    crs: CRS
    found: ModelChange

    @property
    def change(self) -> Change:
        return self.found.change

    @property
    def days(self) -> int | None:
        """Between them, where both days are known."""
        if self.first.date is None or self.second.date is None:
            return None
        return (self.second.date - self.first.date).days


def write_pairs(run: Run, pairs: Sequence[Pair], whole: Pair, context: Context) -> None:
    """Significance of the change of ``whole``, the table of all pairs, and of three or more models their series."""
    _write_significance(run, whole, context)
    zones = [change_zones(pair.change, context.crs) for pair in pairs]
    write_statistics(run, pairs, whole, zones)
    if run.related.classes is not None:
        compared = [
            Compared(p.first.name, p.second.name, p.change, z.correlation) for p, z in zip(pairs, zones, strict=True)
        ]
        compared.insert(0, compared.pop(pairs.index(whole)))
        write_class_budgets(run, compared, run.related.classes, context.crs, whole.second.date)
    if len(pairs) == 1:
        return
    _write_pair_rasters(run, pairs, context)
    _write_zone_series(run, pairs, zones[pairs.index(whole)], zones)
    if all(pair.days is not None for pair in pairs):
        _write_rates(run, pairs, context)


def write_statistics(run: Run, pairs: Sequence[Pair], whole: Pair, zones: Sequence[Zones] = ()) -> None:
    """The table of all pairs, with what their ``zones`` hold where these are known, and the figures of ``whole``."""
    rows = [_row(pair, found) for pair, found in zip_longest(pairs, zones)]
    _write_table(run.stage.path("pairs.csv"), rows)
    run.outputs["pairs"] = run.stage.final("pairs.csv")
    run.facts["coregistration"] = [coregistration_facts(p.found, p.first.name, p.second.name) for p in pairs]
    run.facts["pairs"] = rows
    c = whole.found.coregistration
    if not zones:
        own = rows[pairs.index(whole)]
        run.figures |= {name: value for name, value in own.items() if name not in ("from", "to", "kind", "days")}
    run.figures |= {
        "model_count": 1 + max(pair.indices[1] for pair in pairs),
        "bias_m": c.bias,
        "bias_error_m": c.errors[2],
        "shift_east_m": c.east,
        "shift_north_m": c.north,
        **trend_facts(whole.found),
        "nmad_before_m": c.nmad_before,
        "nmad_after_m": c.nmad_after,
    }


def _tags(pair: Pair, context: Context) -> dict[str, str]:
    c = pair.found.coregistration
    return geotiff.raster_tags(
        epochs=(pair.first.date, pair.second.date),
        median_level=Z95 * float(np.nanmedian(pair.change.error)),
        translation=-np.array([c.east, c.north, c.bias]),
        software=f"SlopeWatch {VERSION}",
        input_sha256=" ".join(context.input_hashes[i] for i in pair.indices),
    )


def _write_significance(run: Run, whole: Pair, context: Context) -> None:
    change = whole.change
    path = run.stage.path("significance.tif")
    geotiff.write_raster(
        path,
        change.dz / change.error,
        change.grid,
        context.crs,
        description="Elevation change over its standard error",
        unit="1",
        tags=_tags(whole, context),
    )
    qgis_styles.write_qml_next_to(path, qgis_styles.change_qml(_SIGNIFICANCE_LIMIT, unit="standard errors"))
    run.outputs["significance"] = run.stage.final(path.name)


def _write_pair_rasters(run: Run, pairs: Sequence[Pair], context: Context) -> None:
    """Change and level of each pair, all with one colour range."""
    moved = np.concatenate([pair.change.dz[pair.change.significant] for pair in pairs])
    level = float(np.median([pair.change.median_level for pair in pairs]))
    limit = palette.colour_limit(moved, level=level)
    highest = max(float(np.nanpercentile(pair.change.level, 98)) for pair in pairs)
    for pair in pairs:
        change, tags = pair.change, _tags(pair, context)
        span = f"{pair.indices[0] + 1}_{pair.indices[1] + 1}"
        words = f"{pair.first.name} to {pair.second.name}"
        path = run.stage.path(f"pairs/elevation_change_{span}.tif")
        legend = Legend(f"Elevation change, {words}", limit)
        write_masked_raster(path, change.dz, change.significant, change.grid, context.crs, legend, tags)
        run.outputs[f"elevation_change_{span}"] = run.stage.final(f"pairs/{path.name}")
        path = run.stage.path(f"pairs/level_of_detection_{span}.tif")
        words = f"Level of detection, {words}"
        geotiff.write_raster(path, change.level, change.grid, context.crs, description=words, tags=tags)
        qgis_styles.write_qml_next_to(path, qgis_styles.level_qml(highest))
        run.outputs[f"level_of_detection_{span}"] = run.stage.final(f"pairs/{path.name}")


def _row(pair: Pair, found: Zones | None) -> dict[str, Any]:
    """A line of the table of pairs."""
    change, c, cells = pair.change, pair.found.coregistration, cells_of(pair.change)
    row: dict[str, Any] = {
        "from": pair.first.name,
        "to": pair.second.name,
        "kind": "against the first" if pair.indices[0] == 0 else "step",
        "days": pair.days,
        "bias_m": c.bias,
        "bias_error_m": c.errors[2],
        "shift_east_m": c.east,
        "shift_north_m": c.north,
        "nmad_m": c.nmad_after,
        **trend_facts(pair.found),
        **change_statistics(change),
    }
    if found is None:
        correlation = fit_correlation(cells, change.stable, change.registration_error)
        table = volume_table(cells, change.significant, zone_volumes((), cells, correlation), correlation)
    else:
        table = volume_table(cells, change.significant, found.volumes, found.correlation)
        figures = table.figures()
        row |= {
            "zones": len(found.frame),
            **figures,
            "vol_net_low_m3": figures["vol_net_m3"] - Z95 * figures["vol_net_err_m3"],
            "vol_net_high_m3": figures["vol_net_m3"] + Z95 * figures["vol_net_err_m3"],
        }
        if pair.days:
            row["vol_net_m3_year"] = figures["vol_net_m3"] * 365.25 / pair.days
    return row | {
        "beyond_m2": table.thresholded.area,
        "beyond_lowering_m3": table.thresholded.lowering,
        "beyond_raising_m3": table.thresholded.raising,
        "all_net_m3": table.raw.net,
        "all_net_err_m3": table.raw_net_error,
    }


def _write_zone_series(run: Run, pairs: Sequence[Pair], whole: Zones, zones: Sequence[Zones]) -> None:
    """The zones of the first and the last model through all of them."""
    rows = []
    for pair, own in zip(pairs, zones, strict=True):
        cells = cells_of(pair.change)
        for name, footprint in zip(whole.frame["zone_id"], whole.footprints, strict=True):
            near = in_window(cells, footprint.window)
            weights = np.where(np.isfinite(near.dz), footprint.weights, 0.0)
            area = float(weights.sum())
            if not area:
                continue
            volume = float(np.sum(weights * np.nan_to_num(near.dz)))
            error = float(own.correlation.sum_error(weights, near))
            row = {
                "zone_id": str(name),
                "from": pair.first.name,
                "to": pair.second.name,
                "kind": "against the first" if pair.indices[0] == 0 else "step",
                "days": pair.days,
                "dz_mean_m": volume / area,
                "dz_err_m": error / area,
                "vol_net_m3": volume,
                "vol_err_m3": error,
            }
            if pair.days:
                row["rate_mm_year"] = 365_250.0 * volume / area / pair.days
                row["rate_err_mm_year"] = 365_250.0 * error / area / pair.days
            rows.append(row)
    if rows:
        _write_table(run.stage.path("zone_series.csv"), rows)
        run.outputs["zone_series"] = run.stage.final("zone_series.csv")


def _write_rates(run: Run, pairs: Sequence[Pair], context: Context) -> None:
    against_first = [pair for pair in pairs if pair.indices[0] == 0]
    days = [0, *(int(pair.days or 0) for pair in against_first)]
    found = cell_rates(
        days, [pair.change.dz for pair in against_first], {pair.indices: pair.change.error for pair in pairs}
    )
    change = against_first[-1].change
    path = run.stage.path("rate.tif")
    bands = {"Rate of the elevation": found.rate, "Standard error of the rate": found.error}
    geotiff.write_bands(path, bands, change.grid, context.crs, unit="mm/year", tags=_tags(against_first[-1], context))
    beyond = np.abs(found.rate) > Z95 * found.error
    limit = palette.colour_limit(found.rate[beyond], level=float(np.nanmedian(Z95 * found.error)))
    qgis_styles.write_qml_next_to(path, qgis_styles.change_qml(limit, unit="mm/year"))
    run.outputs["rate"] = run.stage.final(path.name)
    run.figures["rate_error_median_mm_year"] = float(np.nanmedian(found.error))


def _write_table(path: Path, rows: Sequence[dict[str, Any]]) -> None:
    """A CSV file; what is not known is empty."""
    columns = list(dict.fromkeys(name for row in rows for name in row))
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(columns)
    for row in rows:
        writer.writerow([_written(row.get(name)) for name in columns])
    with atomic_output(path) as partial:
        partial.write_text(text.getvalue(), encoding="utf-8")


def _written(value: Any) -> str:
    if value is None:
        return ""
    return f"{value:.6g}" if isinstance(value, float) else table_cell(value) if isinstance(value, str) else str(value)
