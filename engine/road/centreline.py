"""Centrelines of roads from a vector file, joined into roads with chainages."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import geopandas as gpd
import numpy as np
import pyogrio
import shapely
from pyproj import CRS
from shapely.geometry import LineString
from shapely.geometry.base import BaseGeometry

from ...interface.parameters import RoadParameters
from ..core.arrays import Float
from ..core.errors import InputError
from ..core.gdal_names import readable
from ..core.messages import quoted, shown
from ..crs.reprojection import reprojected
from ..vector.field_mapping import FieldMapping
from ..vector.geopackage import READ_FAULTS
from .chainages import METRES_OF, chainage_of
from .joining import Piece, joined
from .measures import chainages_of, lines_of, read_measures
from .network import Network

TABLE = "centreline"
"""What a mapping of field names calls the fields of a centreline."""
FIELDS = ("route", "carriageway", "chain_from", "chain_to")
_MAX_LENGTH_M = 10_000_000.0
_MAX_RATIO = 1.5  # of a piece's chainage to its length, and the other way round


@dataclass(frozen=True)
class Roads:
    """The lines of a file in metres of one reference system, by route and carriageway.

    ``name`` is the file's for messages, ``notes`` are sentences on what was assumed.
    """

    pieces: Mapping[tuple[str, str], Sequence[Piece]]
    parameters: RoadParameters
    name: str
    notes: tuple[str, ...]

    def network(self, near: BaseGeometry | None = None) -> tuple[Network, tuple[str, ...]]:
        """The roads joined, and all sentences.

        Args:
            near: only roads of which a part lies within reach of it are joined and checked; metres.

        Raises:
            InputError: no road reaches ``near``; or one crosses itself, has a gap, a branch, a part that runs the other
                way, or a jump in its chainage.
        """
        parameters, notes = self.parameters, list(self.notes)
        chosen = self.pieces if near is None else _near(self.pieces, near, parameters, self.name)
        stretches = [s for road in chosen.items() for s in joined(road, parameters, self.name, notes)]
        network = Network(
            tuple(stretches),
            parameters.road_reach,
            parameters.road_tolerance,
            parameters.chainage_style,
            parameters.chainage_unit,
        )
        return network, tuple(notes)


def read_roads(
    path: Path, crs: CRS, parameters: RoadParameters | None = None, names: FieldMapping | None = None
) -> Roads:
    """The lines of a layer.

    Each feature may name its route and carriageway and the chainages of its first and last corner, in the fields
    ``FIELDS`` or those that ``names`` has for them. Without these fields M values are the chainages of all corners.
    Without either they grow from ``parameters.chainage_start`` in the lines' direction.

    Raises:
        InputError: the file cannot be read as lines, a field is missing, or holds no chainage.
    """
    parameters, names = parameters or RoadParameters(), names or FieldMapping()
    name = shown(path)
    notes: list[str] = []
    frame, measures = _read(path, parameters.centreline_layer, name, notes)
    frame = frame.set_geometry(_transformed(frame, crs, name, notes), crs=None)
    return Roads(_roads(frame, measures, names, parameters, name, notes), parameters, name, tuple(notes))


def _read(
    path: Path, layer: str, name: str, notes: list[str]
) -> tuple[gpd.GeoDataFrame, Sequence[Sequence[Float]] | None]:
    """The features, and the M values of their parts where they have any."""
    if not Path(path).exists():
        raise InputError(f"The centreline {name} does not exist; check the path.")
    try:
        with readable(Path(path)) as plain, warnings.catch_warnings(record=True) as said:
            warnings.simplefilter("always")
            chosen = _line_layer(plain, layer, name)
            frame = pyogrio.read_dataframe(plain, layer=chosen, force_2d=True)
            measured = any("Measured (M)" in str(w.message) for w in said)
            measures = read_measures(plain, chosen, list(frame.geometry)) if measured else None
    except READ_FAULTS as error:
        raise InputError(
            f"The centreline {name} cannot be read as a vector file; give lines as GeoPackage, shapefile or GeoJSON."
        ) from error
    if measured and measures is None:
        notes.append(f"The centreline {name} has M values, which cannot be read; give chainages in fields.")
    return frame, measures


def _line_layer(path: Path, wanted: str, name: str) -> str:
    layers = [(str(layer), str(kind)) for layer, kind in pyogrio.list_layers(path) if layer != "layer_styles"]
    if wanted:
        if wanted not in dict(layers):
            there = ", ".join(layer for layer, _ in layers)
            raise InputError(f"The centreline {name} has no layer {wanted}; its layers are {there}.")
        return wanted
    for kinds in (("Line", "Curve"), ("Unknown", "Collection")):
        for layer, kind in layers:
            if any(word in kind for word in kinds):
                return layer
    kinds_there = ", ".join(sorted({kind for _, kind in layers if kind != "None"})) or "no geometry"
    raise InputError(f"The centreline {name} holds no lines ({kinds_there}); give the road's axis as lines.")


def _transformed(frame: gpd.GeoDataFrame, crs: CRS, name: str, notes: list[str]) -> gpd.GeoSeries:
    if frame.crs is None:
        notes.append(f"The centreline {name} declares no reference system; the surveys' ({crs.name}) is assumed.")
        return frame.geometry
    moved = reprojected(list(frame.geometry), frame.crs, crs, f"The centreline {name}", notes)
    return gpd.GeoSeries(moved, index=frame.index)


def _roads(
    frame: gpd.GeoDataFrame,
    measures: Sequence[Sequence[Float]] | None,
    names: FieldMapping,
    parameters: RoadParameters,
    name: str,
    notes: list[str],
) -> dict[tuple[str, str], list[Piece]]:
    """Pieces by route and carriageway, in the order of the file."""
    columns = {ours: _column(frame, ours, names, name) for ours in FIELDS}
    if columns["chain_to"] and not columns["chain_from"]:
        raise InputError(
            f"The centreline {name} has chainages of the lines' ends only; give those of their beginnings."
        )
    if measures is not None and columns["chain_from"]:
        notes.append(f"The centreline {name} has chainages in fields, so its M values are not used.")
        measures = None
    roads: dict[tuple[str, str], list[Piece]] = {}
    for number, (index, geometry) in enumerate(zip(frame.index, frame.geometry, strict=True), 1):
        road = tuple(_text(frame.at[index, columns[c]]) if columns[c] else "" for c in ("route", "carriageway"))
        chains = []
        for ours in ("chain_from", "chain_to"):
            value = frame.at[index, columns[ours]] if columns[ours] else None
            try:
                chains.append(chainage_of(value, parameters.chainage_unit))
            except (TypeError, ValueError) as error:
                raise InputError(
                    f"The field {columns[ours]} of line {number} of the centreline {name} is {quoted(value)}; give a "
                    "number, or a chainage such as K12+345."
                ) from error
        own = roads.setdefault((road[0] or parameters.route_name, road[1]), [])
        if measures is not None and geometry is not None:
            own += _measured_pieces(geometry, measures[number - 1], number, parameters, name)
        else:
            own += _pieces(geometry, (chains[0], chains[1]), number, parameters, name)
    roads = {road: pieces for road, pieces in roads.items() if pieces}
    if not roads:
        raise InputError(f"The centreline {name} holds no line; draw the road's axis.")
    return roads


def _column(frame: gpd.GeoDataFrame, ours: str, names: FieldMapping, name: str) -> str:
    """The field of the file; empty where it has none."""
    fields = [str(f) for f in frame.columns if f != frame.geometry.name]
    # names for all tables are the zones' too, so one that is not there is no mistake
    theirs, asked = names.theirs(ours, TABLE), ours in names.names.get(TABLE, {})
    found = [f for f in fields if f == theirs] or [f for f in fields if f.lower() == theirs.lower()]
    if not found and asked:
        raise InputError(
            f"The centreline {name} has no field {theirs} ({ours}); its fields are {', '.join(fields) or 'none'}."
        )
    return found[0] if found else ""


def _pieces(
    geometry: BaseGeometry | None,
    chains: tuple[float | None, float | None],
    number: int,
    parameters: RoadParameters,
    name: str,
) -> list[Piece]:
    """The lines of a feature; one with chainages of both ends is one line."""
    if geometry is None:
        return []
    lines = [LineString(shapely.remove_repeated_points(p)) for p in lines_of(geometry) if p.length > 0]
    for line in lines:
        _refuse_length(line, number, name)
    begin, end = chains
    if begin is None and end is None:
        return [Piece(line, None, None, number) for line in lines]
    if begin is None:
        raise InputError(f"Line {number} of the centreline {name} has a chainage of its end only; give both, or none.")
    merged = shapely.line_merge(shapely.MultiLineString(lines), directed=True)
    if not isinstance(merged, LineString):
        raise InputError(
            f"Line {number} of the centreline {name} has {len(lines)} parts that do not join, with one chainage; give "
            "each part a feature of its own."
        )
    if end is not None:
        _refuse_scale(merged.length, abs(end - begin), number, parameters, name)
    return [Piece(merged, begin, end, number)]


def _measured_pieces(
    geometry: BaseGeometry, measures: Sequence[Float], number: int, parameters: RoadParameters, name: str
) -> list[Piece]:
    """The lines of a feature with the chainages of their corners by M values, each part by its own."""
    subject, pieces = f"Line {number} of the centreline {name}", []
    for part, values in zip(lines_of(geometry), measures, strict=True):
        if part.length == 0:
            continue
        _refuse_length(part, number, name)
        xy = shapely.get_coordinates(part)
        chains = chainages_of(values, xy, METRES_OF[parameters.chainage_unit], subject)
        if chains is None:
            pieces.append(Piece(LineString(shapely.remove_repeated_points(part)), None, None, number))
            continue
        apart = np.concatenate([[True], (np.diff(xy, axis=0) != 0).any(axis=1)])
        line, chains = LineString(xy[apart]), chains[apart]
        begin, end = float(chains[0]), float(chains[-1])
        _refuse_scale(line.length, abs(end - begin), number, parameters, name)
        pieces.append(Piece(line, begin, end, number, tuple(float(chain) for chain in chains)))
    return pieces


def _refuse_length(line: BaseGeometry, number: int, name: str) -> None:
    if not np.isfinite(line.length) or line.length > _MAX_LENGTH_M:
        raise InputError(
            f"Line {number} of the centreline {name} is {line.length / 1000:.4g} km long; check its reference system."
        )


def _refuse_scale(length: float, chained: float, number: int, parameters: RoadParameters, name: str) -> None:
    if not length / _MAX_RATIO <= chained <= length * _MAX_RATIO:
        unit = METRES_OF[parameters.chainage_unit]
        raise InputError(
            f"Line {number} of the centreline {name} is {length:.1f} m long and its chainages are "
            f"{chained / unit:.6g} {parameters.chainage_unit} apart; check them and --chainage-unit."
        )


def _near(
    roads: Mapping[tuple[str, str], Sequence[Piece]], near: BaseGeometry, parameters: RoadParameters, name: str
) -> dict[tuple[str, str], Sequence[Piece]]:
    """The roads that come within reach."""
    distance = {road: min(p.line.distance(near) for p in pieces) for road, pieces in roads.items()}
    found = {road: pieces for road, pieces in roads.items() if distance[road] <= parameters.road_reach}
    if not found:
        raise InputError(
            f"The centreline {name} does not reach the slope: it ends {min(distance.values()):.0f} m from it, farther "
            f"than --road-reach {parameters.road_reach:g}; give the line of its road, and check its reference system."
        )
    return found


def _text(value: object) -> str:
    if value is None or value != value:
        return ""
    if isinstance(value, float) and value.is_integer():
        return str(int(value))  # a road's number in a field with gaps
    return str(value).strip()
