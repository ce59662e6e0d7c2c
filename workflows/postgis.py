"""A finished run into a PostGIS schema: what is read for it, and what is said of it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import shapely
from pyproj import CRS
from shapely.geometry.base import BaseGeometry

from ..engine.core.checksums import sha256
from ..engine.core.errors import InputError
from ..engine.core.progress import Progress
from ..engine.crs.working_frame import horizontal
from ..engine.handover.held import Held
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


def for_database(database: Database, held: Held, fields: Path | None, progress: Progress) -> ForDatabase:
    """What a database is to get of a run.

    Raises:
        InputError: the run holds no zones, or the mapping file cannot be used.
    """
    return ForDatabase(database, rows_of(held, _road_points(held, progress)), read_field_mapping(fields).flat)


def _road_points(held: Held, progress: Progress) -> dict[str, list[BaseGeometry | None]]:
    """For zones placed on a road, the nearest point of its centreline, if that still is as the run read it."""
    given = {str(i["role"]): i for i in held.record.get("inputs", ())}
    line = given.get("centreline")
    layers = [(layer.name, p) for layer in held.zones if (p := layer.places) is not None and len(p)]
    if line is None or not layers:
        return {}
    path = Path(str(line["path"]))
    if not path.is_file() or sha256(path) != line["sha256"]:
        progress.warning(
            "The centreline of the run is gone or was changed, so events have no point on the road, only their place."
        )
        return {}
    names = Path(str(given["field_names"]["path"])) if "field_names" in given else None
    found = {}
    try:
        for name, places in layers:
            whole = CRS.from_user_input(places.crs)
            crs = horizontal(whole) or whole
            parameters = RoadParameters.build(held.record.get("parameters", {}).get("road") or {})
            roads = read_roads(path, crs, parameters, read_field_mapping(names))
            network = roads.network(shapely.box(*places.total_bounds))[0]
            routes = [str(v or "") for v in places["route"]] if "route" in places else [""] * len(places)
            chained = places["chain_from"].notna() if "chain_from" in places else [False] * len(places)
            found[name] = [
                _nearest(network, shape, route) if placed else None
                for shape, route, placed in zip(places.geometry, routes, chained, strict=True)
            ]
    except InputError as error:
        progress.warning(f"Events have no point on the road: {error}")
        return {}
    return found


def _nearest(network: Network, shape: BaseGeometry | None, route: str) -> BaseGeometry | None:
    """The foot of a shape's centroid on the nearest stretch of its route."""
    lines: Sequence[BaseGeometry] = [s.line for s in network.stretches if s.route == route]
    if shape is None or shape.is_empty or not lines:
        return None
    line = min(lines, key=shape.distance)
    return shapely.force_2d(line.interpolate(line.project(shape.centroid)))
