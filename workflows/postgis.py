"""A finished run into a PostGIS schema: what is read for it, and what is said of it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import geopandas as gpd
import numpy as np
import shapely
from pyproj import CRS
from shapely.geometry.base import BaseGeometry

from ..engine.core.checksums import sha256
from ..engine.core.errors import InputError
from ..engine.core.progress import Progress
from ..engine.crs.working_frame import horizontal
from ..engine.handover.corridor import records_of_slopes
from ..engine.handover.held import Held, read_record
from ..engine.handover.postgis.address import Database
from ..engine.handover.postgis.writing import Counts, Rows, hand_over
from ..engine.road.centreline import read_roads
from ..engine.road.network import Network
from ..engine.vector.field_mapping import read_field_mapping
from ..interface.parameters import HandoverParameters, RoadParameters
from .postgis_rows import rows_of


@dataclass(frozen=True)
class ForDatabase:
    """Rows that are ready for a database, and an agency's names for its views."""

    database: Database
    rows: Rows
    names: Mapping[str, str]

    def write(self, parameters: HandoverParameters, progress: Progress) -> Counts:
        """Write them; see ``hand_over``."""
        counts = hand_over(
            self.database, self.rows, parameters.schema, parameters.srid, names=self.names, progress=progress
        )
        if counts.newer:
            progress.warning(
                f"{counts.newer} zones and events are of a later run in the database, so they stay as they are there."
            )
        return counts


@dataclass(frozen=True)
class _Centreline:
    """A centreline as a run read it: its file and checksum, names of its fields, and how its chainages are meant."""

    path: Path
    sha256: str
    names: Path | None
    parameters: RoadParameters


def for_database(database: Database, held: Held, fields: Path | None, progress: Progress) -> ForDatabase:
    """What a database is to get of a run.

    Raises:
        InputError: the run holds no zones, or the mapping file cannot be used.
    """
    return ForDatabase(database, rows_of(held, _road_points(held, progress)), read_field_mapping(fields).flat)


def _road_points(held: Held, progress: Progress) -> dict[str, list[BaseGeometry | None]]:
    """For zones placed on a road, the nearest point of its centreline, if that still is as the run read it."""
    found = {}
    try:
        given = _centrelines(held)
        for layer in held.zones if given else ():
            places = layer.places
            if places is not None and len(places):
                slopes = places["slope"].astype(str).to_numpy() if "slope" in places else np.full(len(places), "")
                found[layer.name] = _feet(places, [given.get(s, given.get("")) for s in slopes], progress)
    except InputError as error:
        progress.warning(f"Events have no point on the road: {error}")
        return {}
    return found


def _centrelines(held: Held) -> dict[str, _Centreline]:
    """The centreline of each slope of a corridor by its name; that of the run itself has none."""
    own = _centreline_of(held.record)
    found = {} if own is None else {"": own}
    for slope, path in records_of_slopes(held).items():
        line = _centreline_of(read_record(path))
        if line is not None:
            found[slope] = line
    return found


def _centreline_of(record: Mapping[str, Any]) -> _Centreline | None:
    given = {str(i["role"]): i for i in record.get("inputs", ())}
    line = given.get("centreline")
    if line is None:
        return None
    names = Path(str(given["field_names"]["path"])) if "field_names" in given else None
    parameters = RoadParameters.build(record.get("parameters", {}).get("road") or {})
    return _Centreline(Path(str(line["path"])), str(line["sha256"]), names, parameters)


def _feet(
    places: gpd.GeoDataFrame, lines: Sequence[_Centreline | None], progress: Progress
) -> list[BaseGeometry | None]:
    """The point on its road of each row, whose centreline is in ``lines``."""
    whole = CRS.from_user_input(places.crs)
    crs = horizontal(whole) or whole
    routes = [str(v or "") for v in places["route"]] if "route" in places else [""] * len(places)
    placed = places["chain_from"].notna().to_numpy() if "chain_from" in places else np.zeros(len(places), bool)
    found: list[BaseGeometry | None] = [None] * len(places)
    for line in dict.fromkeys(line for line in lines if line is not None):
        if not line.path.is_file() or sha256(line.path) != line.sha256:
            progress.warning(
                "The centreline of the run is gone or was changed, so events have no point on the road, only their "
                "place."
            )
            continue
        rows = [number for number, its in enumerate(lines) if its == line and placed[number]]
        if rows:
            roads = read_roads(line.path, crs, line.parameters, read_field_mapping(line.names))
            network = roads.network(shapely.box(*places.iloc[rows].total_bounds))[0]
            for number in rows:
                found[number] = _nearest(network, places.geometry.iloc[number], routes[number])
    return found


def _nearest(network: Network, shape: BaseGeometry | None, route: str) -> BaseGeometry | None:
    """The foot of a shape's centroid on the nearest stretch of its route."""
    lines: Sequence[BaseGeometry] = [s.line for s in network.stretches if s.route == route]
    if shape is None or shape.is_empty or not lines:
        return None
    line = min(lines, key=shape.distance)
    return shapely.force_2d(line.interpolate(line.project(shape.centroid)))
