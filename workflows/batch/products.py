"""What a batch writes of all slopes together."""

from __future__ import annotations

import importlib.util
import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import geopandas as gpd
import numpy as np
import pandas as pd
import pyogrio
import shapely
from pyproj import CRS

from ...engine.core.errors import InputError
from ...engine.core.gdal_names import readable
from ...engine.core.json_values import plain
from ...engine.maps import qgis_styles
from ...engine.vector.area import read_roi
from ...engine.vector.geopackage import Layer, read_layer, write_layers
from ...engine.vector.review_fields import is_located, own_columns
from ...interface.parameters import DetailParameters
from ..run import Run
from . import alert_events, corridor_zones
from .catalogue import MadeCloud, item_collection
from .jobs import Slope
from .mosaic import mosaic, read_tile
from .pages import Shown, page_of, write_pdf_of
from .product_names import CATALOGUE, GEOPACKAGE, MOSAIC, MOSAIC_STYLE, PAGE, PAGE_PDF, PARQUET
from .ranking import Ranked, rank
from .regions_on_roads import Road, placed_regions
from .results import SlopeResult

_NO_PARQUET = "GeoParquet is written only with pyarrow; install it with: pip install 'slopewatch[parquet]'"
_CLOUDS = {"aligned": "aligned ground", "epoch_ground": "ground", "reference_ground": "ground"}
_SCREENED = {"screened": "screened ground"}


@dataclass(frozen=True)
class Made:
    """What the products are made of: slopes in the manifest's order, those with results, and why others failed;
    ``roads`` by slope.
    """

    slopes: Sequence[Slope]
    results: Sequence[SlopeResult]
    failed: Sequence[tuple[str, str]]
    manifest: Path
    roads: Mapping[str, Road]
    details: DetailParameters = field(default_factory=DetailParameters)


def write_products(run: Run, made: Made, earlier_alerts: gpd.GeoDataFrame | None) -> None:
    """Write all of them into the run's stage, and their figures into the run.

    Raises:
        InputError: a file of a slope cannot be read.
    """
    directory = run.stage.directory
    with run.step("zones", 0.90, 0.95, "gathering the zones"):
        zones = corridor_zones.corridor_zones(made.results, run.progress)
        if run.reviews is not None:
            zones = run.reviews.carried_to(zones, GEOPACKAGE, corridor_zones.FIELDS, persistent_ids=True)
        days = corridor_zones.last_days(made.results)
        alerts = alert_events.follow_alerts(earlier_alerts, zones, days)
    with run.step("products", 0.95, 0.99, "writing what all slopes share"):
        ranked = rank(made.results, zones, alerts, directory)
        slopes = _slopes_frame(made, ranked, zones.crs)
        _write_tables(run, zones, alerts, slopes)
        _write_parquet(run, zones)
        _write_mosaic(run, made.results)
        _write_catalogue(run, made.results)
        still = alert_events.open_of(alerts)
        folders = {result.slope: result.folder for result in made.results}
        shown = Shown(ranked, made.failed, zones, still, slopes, folders, made.manifest.name, run.figures["slopes"])
        _write_pages(run, shown, made.details)
        run.facts["manifest"] = made.manifest.name
    run.figures |= {
        "zones": len(zones),
        "alerts": len(alerts),
        "open_alerts": len(still),
        "highest_attention": max((slope.attention for slope in ranked), default=0),
    }


def _write_pages(run: Run, shown: Shown, details: DetailParameters) -> None:
    """The page, and the report to sign, if it is wanted; else that of an earlier run goes."""
    # a name that is no Unicode is written with escapes rather than not at all
    run.stage.path(PAGE).write_text(page_of(shown), encoding="utf-8", errors="backslashreplace", newline="\n")
    run.outputs["page"] = run.stage.final(PAGE)
    if not details.pdf:
        run.stage.discard(PAGE_PDF)
        return
    write_pdf_of(shown, run.stage.path(PAGE_PDF), asdict(details), run.record.started.isoformat(), run.progress)
    run.outputs["page_pdf"] = run.stage.final(PAGE_PDF)


def read_alerts(folder: Path) -> gpd.GeoDataFrame | None:
    """The alerts of an earlier run; None where there are none.

    Raises:
        InputError: the file is there and cannot be read, so that its alerts would be lost.
    """
    path = folder / GEOPACKAGE
    if not path.exists():
        return None
    try:
        with readable(path) as plain_path:
            layers = [str(name) for name, _ in pyogrio.list_layers(plain_path)]
        if "alerts" not in layers:
            return None
        frame = read_layer(path, "alerts")
    except (RuntimeError, OSError, ValueError, shapely.errors.ShapelyError) as error:
        raise InputError(
            f"{path} cannot be read, so its alerts would be lost; repair it, or move it elsewhere."
        ) from error
    frame = frame.rename(columns=alert_events.FORMER)
    for name, kind in alert_events.FIELDS.items():
        if name not in frame:
            frame[name] = "" if kind == "text" else np.nan
        if kind == "text":
            frame[name] = frame[name].astype(object).where(frame[name].notna(), "")
    return frame


def _write_tables(run: Run, zones: gpd.GeoDataFrame, alerts: gpd.GeoDataFrame, slopes: gpd.GeoDataFrame) -> None:
    zone_style = qgis_styles.corridor_zones_qml(corridor_zones.FIELDS, located=is_located(zones))
    alert_style = qgis_styles.corridor_alerts_qml(alert_events.FIELDS, alert_events.STATES, alert_events.ENTERED)
    write_layers(
        run.stage.path(GEOPACKAGE),
        [
            Layer(zones, "zones", zone_style, "MultiPolygon", own_columns(zones, corridor_zones.FIELDS), guarded=True),
            Layer(alerts, "alerts", alert_style, "MultiPolygon", alert_events.OWN, guarded=True),
            Layer(slopes, "slopes", "", "MultiPolygon"),
        ],
    )
    run.outputs["corridor"] = run.stage.final(GEOPACKAGE)


def _slopes_frame(made: Made, ranked: Sequence[Ranked], crs: Any) -> gpd.GeoDataFrame:
    """One row a slope with its region, the most urgent first, those that failed last."""
    places = {slope.slope: (number, slope) for number, slope in enumerate(ranked, 1)}
    failed = dict(made.failed)
    known = sorted(made.slopes, key=lambda s: places[s.name][0] if s.name in places else len(made.slopes) + 1)
    rows = []
    for slope in known:
        place, figures = places.get(slope.name, (None, None))
        rows.append(
            {
                "slope": slope.name,
                "place": pd.NA if place is None else place,
                "state": "done" if figures else "failed",
                "sentence": "" if figures else failed.get(slope.name, ""),
                "attention": pd.NA if figures is None else figures.attention,
                "open_alerts": pd.NA if figures is None else figures.open_alerts,
                "zones": pd.NA if figures is None else figures.zones,
                "surveys": len(slope.surveys),
                "last_survey": slope.surveys[-1].day.isoformat(),
                "report": "" if figures is None else figures.report,
            }
        )
    known_names = {slope.name for slope in known}
    others = [name for name in failed if name not in known_names]
    rows += [{"slope": name, "state": "failed", "sentence": failed[name]} for name in others]
    columns = (
        "slope",
        "place",
        "state",
        "sentence",
        "attention",
        "open_alerts",
        "zones",
        "surveys",
        "last_survey",
        "report",
    )
    numbers = ("place", "attention", "open_alerts", "zones", "surveys")
    table = {
        name: pd.Series(
            [row.get(name, pd.NA if name in numbers else "") for row in rows],
            dtype="Int64" if name in numbers else object,
        )
        for name in columns
    }
    shapes = np.array([*(_region(slope, crs) for slope in known), *(None for _ in others)], dtype=object)
    frame = gpd.GeoDataFrame(table, geometry=shapes if len(rows) else [], crs=crs)
    return placed_regions(frame, made.roads)


def _region(slope: Slope, crs: Any) -> shapely.MultiPolygon | None:
    if slope.roi is None or crs is None:
        return None
    try:
        shape = read_roi(slope.roi, CRS.from_user_input(crs)).geometry
    except InputError:  # the slope itself has failed with that sentence
        return None
    return shape if isinstance(shape, shapely.MultiPolygon) else shapely.MultiPolygon([shape])


def _write_parquet(run: Run, zones: gpd.GeoDataFrame) -> None:
    if importlib.util.find_spec("pyarrow") is None:
        run.progress.info(_NO_PARQUET)
        run.stage.discard(PARQUET)
        return
    zones.to_parquet(run.stage.path(PARQUET), compression="zstd", index=False, schema_version="1.1.0")
    run.outputs["parquet"] = run.stage.final(PARQUET)


def _write_mosaic(run: Run, results: Sequence[SlopeResult]) -> None:
    """The change of each slope since its first survey, or between its two."""
    rasters = []
    for result in results:
        last = max((k for k in result.outputs if k.startswith("cumulative_change_")), default="elevation_change")
        if last in result.outputs:
            rasters.append(read_tile(result.outputs[last]))
    if not rasters:
        run.stage.discard(MOSAIC)
        run.stage.discard(MOSAIC_STYLE)
        return
    text, left_out = mosaic(rasters, run.stage.directory)
    if left_out:
        run.progress.warning(
            f"The mosaic leaves out {len(left_out)} slopes whose reference system is not that of the first."
        )
    # checked where it will lie: its rasters are named from there
    run.stage.path(MOSAIC).write_text(text, encoding="utf-8")
    # without a style it is grey; the slopes' colours differ in nothing but where they end
    styles = [style for tile in rasters if (style := tile.path.with_suffix(".qml")).is_file()]
    if styles:
        run.stage.path(MOSAIC_STYLE).write_bytes(styles[0].read_bytes())
    run.outputs["mosaic"] = run.stage.final(MOSAIC)


def _write_catalogue(run: Run, results: Sequence[SlopeResult]) -> None:
    document, notes = item_collection([c for result in results for c in clouds_of(result)], run.stage.directory)
    for note in notes:
        run.progress.warning(note)
    text = json.dumps(plain(document), indent=1, ensure_ascii=True, allow_nan=False)
    run.stage.path(CATALOGUE).write_text(text + "\n", encoding="utf-8")
    run.outputs["clouds"] = run.stage.final(CATALOGUE)


def clouds_of(result: SlopeResult) -> list[MadeCloud]:
    """The clouds that a slope's run made: its ground, the later one in the earlier one's frame, and what was screened.

    A series keeps the ground of each survey among what it continues from; its record names their classified clouds.
    """
    first, last = result.days[0], result.days[-1]
    found = []
    for key, kind in (*_CLOUDS.items(), *_SCREENED.items()):
        if key in result.outputs:
            day = first if key == "reference_ground" else last
            found.append(MadeCloud(result.slope, result.outputs[key], day, kind))
    for day, facts in _series_epochs(result.record).items():
        name = str(facts.get("classified", ""))
        path = result.folder / name.replace("_classified.laz", "_ground.laz")
        if name.endswith("_classified.laz") and path.is_file():
            found.append(MadeCloud(result.slope, path, day, "ground"))
    return found


def _series_epochs(record: Mapping[str, Any]) -> dict[str, dict[str, Any]]:
    for stage in record.get("stages", []):
        if isinstance(stage, dict) and stage.get("stage") == "surveys" and isinstance(stage.get("epochs"), dict):
            return {str(day): facts for day, facts in stage["epochs"].items() if isinstance(facts, dict)}
    return {}
