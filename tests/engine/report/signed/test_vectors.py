"""Which vectors of motion the maps of a report to sign show."""

from __future__ import annotations

from datetime import date

import geopandas as gpd
import numpy as np
from shapely import Point, box
from slopewatch.engine.report.signed.source import vectors_of_motion
from slopewatch.engine.vector.geopackage import write_layer

CRS = "EPSG:32651"


def _written(path, places, zones, **columns):
    frame = gpd.GeoDataFrame(columns, geometry=[Point(place) for place in places], crs=CRS)
    write_layer(path, frame, "vectors")
    gpd.GeoDataFrame({"zone_id": range(len(zones))}, geometry=zones, crs=CRS).to_file(path, layer="zones")
    return path


def test_single_vectors_beyond_the_zones_that_move_are_left_out(tmp_path):
    places, east, north = [(1, 1), (2, 1), (30, 30)], [0.1, 0.2, 0.9], [-0.3, -0.4, 0.9]
    path = _written(tmp_path / "displacement.gpkg", places, [box(0, 0, 5, 5)], east_m=east, north_m=north)
    assert np.allclose(vectors_of_motion(path), [[1, 1, 0.1, -0.3], [2, 1, 0.2, -0.4]])


def test_of_a_series_those_until_the_last_survey(tmp_path):
    columns = {"east_m": [0.1, 0.5], "north_m": [0.0, 0.0], "time_to": [date(2025, 1, 1), date(2025, 6, 1)]}
    path = _written(tmp_path / "displacement.gpkg", [(1, 1), (1, 1)], [box(0, 0, 5, 5)], **columns)
    assert np.allclose(vectors_of_motion(path), [[1, 1, 0.5, 0.0]])


def test_without_motion_there_are_none(tmp_path):
    assert vectors_of_motion(tmp_path / "displacement.gpkg").shape == (0, 4)
