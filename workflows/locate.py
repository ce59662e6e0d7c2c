"""``slopewatch locate``: a layer in, the same layer with its places on a road out."""

from __future__ import annotations

import sqlite3
from contextlib import closing
from pathlib import Path

import geopandas as gpd
import numpy as np
import pyogrio
import shapely
from pyproj import CRS

from ..engine.core.errors import InputError
from ..engine.core.gdal_names import readable
from ..engine.core.messages import shown
from ..engine.core.progress import Progress
from ..engine.core.run_result import RunResult
from ..engine.core.staged_outputs import refuse_unwritable
from ..engine.crs.reprojection import reprojected
from ..engine.maps.qgis_styles import zones_qml
from ..engine.road.centreline import FIELDS as ROAD_FIELDS
from ..engine.road.centreline import TABLE as OF_ROADS
from ..engine.road.centreline import read_roads
from ..engine.road.locating import PLACED, Located, located
from ..engine.vector.field_mapping import FieldMapping, read_field_mapping
from ..engine.vector.geopackage import READ_FAULTS, Layer, write_layers
from ..engine.vector.review_fields import LOCATION, ON_ROAD, is_entered
from ..engine.zones.fields import FIELDS
from ..interface.parameters import RoadParameters
from .layer_files import LayerFiles
from .run import Run, record_name_of

TABLE = "zones"
"""What a mapping of field names calls the fields that are filled in."""


def locate_step(
    source: Path,
    output: Path,
    files: LayerFiles,
    parameters: RoadParameters,
    *,
    layer: str = "",
    overwrite: bool = False,
    progress: Progress,
) -> RunResult:
    """Write a layer again with route, chainage, side and offset of each of its polygons, lines or points.

    Args:
        source: any vector file, such as the zones.gpkg of a former run.
        output: GeoPackage with one layer of the same name.
        files: the centreline, and the agency's names of its fields and of those that are filled in.
        layer: of ``source``; its first one with shapes where it is empty.

    Raises:
        InputError: something given cannot be used; nothing is written then.
    """
    centreline = files.centreline
    if centreline is None:
        raise InputError("There is no centreline; give the road's axis by --centreline.")
    if output.suffix.lower() != ".gpkg":
        raise InputError(f"The output {output} is to be a GeoPackage; end its name in .gpkg.")
    refuse_unwritable(output)
    inputs = [("layer", source), *files.inputs]
    run = Run("locate", {"road": parameters}, inputs, progress)
    record = record_name_of(output)
    run.refuse_folder(output.absolute().parent, (output.name, record), overwrite=overwrite)
    run.hash_inputs()
    names = read_field_mapping(files.field_names)
    with run.writing(output.absolute().parent, record_name=record) as stage:
        with run.step("read", 0.0, 0.3, "reading the layer"):
            chosen, frame = _read(source, layer)
        with run.step("locate", 0.3, 0.9, "locating"):
            found = _located(run, frame, centreline, parameters, names)
        with run.step("write", 0.9, 1.0, "writing"):
            _say_not_filled_in(names, progress)
            table = _with_places(run, frame, found, names.renamed(PLACED, TABLE))
            style = _style(source, chosen)
            if set(FIELDS) <= set(table.columns):
                style = zones_qml(located=True)
            own = tuple(str(c) for c in table.columns if c != table.geometry.name)
            write_layers(stage.path(output.name), [Layer(table, chosen, style, own=own)])
        run.outputs["located"] = stage.final(output.name)
        run.figures = {
            "layer": chosen,
            "features": len(frame),
            "located": found.placed,
            "not_located": len(found.unplaced),
            "roads": len({row for row in found.frame["route"] if row}),
        }
    return run.result()


def _say_not_filled_in(names: FieldMapping, progress: Progress) -> None:
    """Other columns of the layer keep their names, whatever the file calls them."""
    of_tables = [f"{TABLE}.{name}" for name in PLACED] + [f"{OF_ROADS}.{name}" for name in ROAD_FIELDS]
    known = {*PLACED, *ROAD_FIELDS, *of_tables}
    other = [name for name in names.flat if name not in known]
    if other:
        progress.warning(f"The mapping file names fields that are not filled in here: {', '.join(other)}.")


def _read(source: Path, wanted: str) -> tuple[str, gpd.GeoDataFrame]:
    """Name and table of the layer.

    Raises:
        InputError: missing, no vector file, or without that layer or a shape.
    """
    name = shown(source)
    if not source.exists():
        raise InputError(f"The layer {name} does not exist; check the path.")
    try:
        with readable(source) as plain:
            layers = {str(n): k for n, k in pyogrio.list_layers(plain) if n != "layer_styles"}
            if wanted and wanted not in layers:
                raise InputError(f"{name} has no layer {wanted}; its layers are {', '.join(layers)}.")
            shaped = [n for n, kind in layers.items() if kind is not None and n == (wanted or n)]
            if not shaped:
                raise InputError(f"{name} has no layer with shapes; give polygons, lines or points.")
            frame = pyogrio.read_dataframe(plain, layer=shaped[0])
    except READ_FAULTS as error:
        raise InputError(
            f"The layer {name} cannot be read as a vector file; give a GeoPackage, shapefile or GeoJSON."
        ) from error
    if frame.empty or frame.geometry.is_empty.all() or frame.geometry.isna().all():
        raise InputError(f"The layer {shaped[0]} of {name} holds no shape, so that there is nothing to locate.")
    return shaped[0], frame


def _located(
    run: Run, frame: gpd.GeoDataFrame, centreline: Path, parameters: RoadParameters, names: FieldMapping
) -> Located:
    """The layer in metres with its places."""
    notes: list[str] = []
    crs = _metres(frame, centreline)
    shapes = frame.geometry.force_2d()
    if frame.crs is None:
        notes.append(f"The layer declares no reference system; the centreline's ({crs.name}) is assumed.")
    else:
        moved = reprojected(list(shapes), CRS.from_user_input(frame.crs), crs, "The layer", [])
        shapes = gpd.GeoSeries(moved, index=frame.index)
    around = shapely.box(*shapes.total_bounds)
    network, more = read_roads(centreline, crs, parameters, names).network(around)
    for note in (*notes, *more):
        run.progress.warning(note)
    whole = gpd.GeoDataFrame(geometry=shapes.to_numpy(), crs=crs)
    if "zone_id" in frame:
        whole["zone_id"] = frame["zone_id"].to_numpy()
    found = located(whole, network)
    for sentence in found.warnings("features"):
        run.progress.warning(sentence)
    return found


def _metres(frame: gpd.GeoDataFrame, centreline: Path) -> CRS:
    """A reference system in metres: the layer's, else the centreline's, else the zone of UTM."""
    try:
        with readable(centreline) as plain:
            of_road = pyogrio.read_info(plain).get("crs")
    except READ_FAULTS:
        of_road = None  # reading it says why
    for declared in (frame.crs, of_road):
        if declared is not None:
            crs = CRS.from_user_input(declared)
            if crs.is_projected and crs.axis_info[0].unit_conversion_factor == 1.0:
                return crs
    if frame.crs is None:
        raise InputError(
            "Neither the layer nor the centreline declares a projected reference system; save one with its own."
        )
    return CRS.from_user_input(frame.estimate_utm_crs())


def _with_places(run: Run, frame: gpd.GeoDataFrame, found: Located, names: dict[str, str]) -> gpd.GeoDataFrame:
    """The layer as it was, with the places under these names, in the place of fields that have them already."""
    there = {str(c).lower(): str(c) for c in frame.columns if c != frame.geometry.name}
    replaced = [other for name in ON_ROAD if _holds(frame, there.get((other := names[name]).lower()))]
    if replaced:
        run.progress.info(f"What the fields {', '.join(replaced)} held is replaced in the output.")
    wanted = {other.lower() for other in names.values()}
    of_zones = LOCATION in frame  # which have the fields under our names, to be filled in
    renamed = {there[other.lower()]: other for other in names.values() if other.lower() in there}
    renamed |= {name: other for name, other in names.items() if of_zones and name in frame and name not in wanted}
    return frame.rename(columns=renamed).assign(
        **{other: found.frame[name].to_numpy() for name, other in names.items()}
    )


def _holds(frame: gpd.GeoDataFrame, column: str | None) -> bool:
    return column is not None and any(is_entered(column, value) for value in np.asarray(frame[column], dtype=object))


def _style(source: Path, layer: str) -> str:
    """The style that a GeoPackage holds for a layer; empty where it holds none."""
    if source.suffix.lower() != ".gpkg":
        return ""
    try:
        with closing(sqlite3.connect(f"{source.absolute().as_uri()}?mode=ro", uri=True)) as database:
            row = database.execute(
                "SELECT styleQML FROM layer_styles WHERE f_table_name = ? ORDER BY useAsDefault DESC", (layer,)
            ).fetchone()
    except sqlite3.Error:
        return ""
    return str(row[0] or "") if row else ""
