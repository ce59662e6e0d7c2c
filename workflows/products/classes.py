"""The change by class of asset: a table of all comparisons, and a layer of the classes with that of the whole time."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import date
from typing import Any

import geopandas as gpd
import numpy as np
import pandas as pd
from pyproj import CRS

from ...engine.change.result import Change
from ...engine.core.table_text import cell
from ...engine.crs.working_frame import horizontal
from ...engine.maps.qgis_styles import classes_qml
from ...engine.vector.asset_classes import AssetClasses
from ...engine.vector.geopackage import Layer, write_layers
from ...engine.zones.change_zones import cells_of
from ...engine.zones.class_budget import COLUMNS, ClassBudget, class_budgets
from ...engine.zones.volumes import CorrelationModel
from ..run import Run

CLASS_OUTPUTS = ("budget_by_class.csv", "budget_by_class.gpkg")
"""Written where classes were given."""
_DECIMALS = 6


@dataclass(frozen=True)
class Compared:
    """A comparison: names of the earlier and the later survey, its change, and how the errors are related."""

    first: str
    last: str
    change: Change
    correlation: CorrelationModel


def write_class_budgets(
    run: Run, pairs: Sequence[Compared], classes: AssetClasses, crs: CRS, stamp: date | None = None
) -> None:
    """Write table and layer; ``run`` gets their paths and the rows of the first of ``pairs``, which the layer shows.

    Raises:
        InputError: classes overlap, or lie elsewhere.
    """
    labels = classes.labels(pairs[0].change.grid)
    named = [(name, float(shape.area)) for name, shape in zip(classes.names, classes.shapes, strict=True)]
    tables = [class_budgets(cells_of(p.change), p.change.significant, labels, named, p.correlation) for p in pairs]
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(["from", "to", *COLUMNS])
    for pair, rows in zip(pairs, tables, strict=True):
        for row in rows:
            writer.writerow([cell(pair.first), cell(pair.last), *(_text(value) for value in row.row().values())])
    run.stage.path("budget_by_class.csv").write_text(text.getvalue(), encoding="utf-8", newline="\n")
    frame = _frame(tables[0][: len(classes.names)], pairs[0], classes, crs)
    layer = Layer(frame, "budget_by_class", classes_qml(frame.columns[:-1]), "MultiPolygon", guarded=True)
    write_layers(run.stage.path("budget_by_class.gpkg"), [layer], stamp=stamp)
    run.outputs |= {
        "budget_by_class": run.stage.final("budget_by_class.csv"),
        "classes": run.stage.final("budget_by_class.gpkg"),
    }
    run.facts["classes"] = [{k: v for k, v in row.row().items() if v is not None} for row in tables[0]]


def _frame(rows: Sequence[ClassBudget], pair: Compared, classes: AssetClasses, crs: CRS) -> gpd.GeoDataFrame:
    columns: dict[str, Any] = {name: [row.row()[name] for row in rows] for name in COLUMNS}
    table = pd.DataFrame(columns)
    numbers = [name for name in COLUMNS if name != "class"]
    table[numbers] = table[numbers].astype(np.float64).round(_DECIMALS)
    table["epoch_from"], table["epoch_to"] = pair.first, pair.last
    return gpd.GeoDataFrame(table, geometry=list(classes.shapes), crs=horizontal(crs))


def _text(value: str | float | None) -> str:
    if isinstance(value, str):
        return cell(value)
    return "" if value is None else repr(round(value, _DECIMALS) + 0.0)  # + 0.0: no minus zero
