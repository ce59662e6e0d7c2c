"""Readers of the files that are given next to clouds, and of the results that a later command reads, each on a path."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import geopandas
import numpy as np
import shapely
from pyproj import CRS
from slopewatch.engine.core.errors import InputError
from slopewatch.engine.elevation_models.model import read_model
from slopewatch.engine.flight.flown_tracks import read_trajectory
from slopewatch.engine.handover.held import read_record
from slopewatch.engine.road.centreline import read_roads
from slopewatch.engine.vector.asset_classes import read_asset_classes
from slopewatch.engine.vector.field_mapping import read_field_mapping
from slopewatch.interface.parameters import ParameterError, command_sets
from slopewatch.interface.settings_file import read_settings
from slopewatch.lab.fuzz import mutations, targets_given
from slopewatch.lab.fuzz.mutations import Mutation
from slopewatch.tests.builders import elevation_models, epoch_pairs, flights
from slopewatch.workflows.batch.dask_cluster import read_queue
from slopewatch.workflows.batch.manifest import read_manifest
from slopewatch.workflows.compareflight import read_promised

Reader = Callable[[Path], object]
SYSTEM = CRS.from_epsg(32651)
_X, _Y = epoch_pairs.X, epoch_pairs.Y


def _settings(path: Path) -> None:
    try:
        read_settings(path, command_sets.INSPECT)
    except ParameterError as error:  # the command line ends it with a full stop
        raise InputError(f"{error}.") from error


def _roads(path: Path) -> None:
    read_roads(path, SYSTEM).network(shapely.box(_X, _Y, _X + 12, _Y + 12))


def _corridor(path: Path) -> None:
    """What is wrong with a row is no refusal but a problem of its slope: one sentence, too."""
    corridor = read_manifest(path, path.parent / "regions")
    for problem in corridor.problems:
        assert "\n" not in problem.sentence, problem
        assert problem.sentence.endswith("."), problem


GIVEN: dict[str, tuple[Reader, Mutation]] = {
    "names.json": (read_field_mapping, mutations.changed_json),
    "names.csv": (read_field_mapping, mutations.changed_table),
    "settings.json": (_settings, mutations.changed_json),
    "settings.toml": (_settings, mutations.changed_bytes),
    "road.gpkg": (_roads, mutations.changed_database),
    "road.geojson": (_roads, mutations.changed_json),
    "classes.gpkg": (lambda path: read_asset_classes(path, "class", SYSTEM), mutations.changed_database),
    "track.csv": (read_trajectory, mutations.changed_table),
    "plan.gpkg": (read_promised, mutations.changed_database),
    "dem.tif": (read_model, mutations.changed_tags),
    "corridor.csv": (_corridor, mutations.changed_table),
    "corridor.gpkg": (_corridor, mutations.changed_database),
    "cluster.json": (read_queue, mutations.changed_json),
    "handed.json": (read_record, mutations.changed_json),
}
"""Reader and kind of change by the name of the sound file that ``write_given`` makes."""


def write_given(folder: Path, record: dict[str, object]) -> None:
    """A sound file for each reader of ``GIVEN``; ``record`` is that of a run."""
    targets_given.names(folder)
    targets_given.settings(folder)
    for ending in ("gpkg", "geojson"):
        targets_given.centreline(folder / f"road.{ending}")
    targets_given.classes(folder / "classes.gpkg")
    targets_given.trajectory(folder / "track.csv")
    _plan(folder / "plan.gpkg")
    elevation_models.write_turned(folder / "dem.tif", 20.0, (1.0, 0.8), (20, 30))  # passes all that a plain one does
    targets_given.corridor(folder, [folder / f"cloud.{ending}" for ending in ("las", "laz")])
    text = json.dumps(record)
    (folder / "handed.json").write_text(text, encoding="utf-8")


def _plan(path: Path) -> None:
    """Two lines over a few places, as ``planflight`` writes them."""
    west, north = flights.WEST, flights.NORTH
    lines = [shapely.LineString([(west, north - y, 180.0), (west + 40, north - y, 185.0)]) for y in (10.0, 30.0)]
    geopandas.GeoDataFrame({"line": [1, 2]}, geometry=lines, crs=SYSTEM).to_file(path, layer="lines")
    boxes = [shapely.box(west + x, north - y - 5, west + x + 5, north - y) for x in (0, 5, 10) for y in (0, 5, 10)]
    values = {"returns_m2": np.full(9, 80.0), "ground_m2": np.full(9, 20.0)}
    geopandas.GeoDataFrame(values, geometry=boxes, crs=SYSTEM).to_file(path, layer="places")
