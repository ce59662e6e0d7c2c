"""Polygons that people drew, as two commands read them."""

from __future__ import annotations

from pathlib import Path

import geopandas
import pytest
import shapely
from shapely import Point, Polygon, box
from slopewatch.engine.core.errors import InputError
from slopewatch.engine.vector.polygon_file import read_polygons

BOW = Polygon([(0, 0), (2, 2), (2, 0), (0, 2)])
"""It crosses itself: two triangles of one square metre each."""


def written(path: Path, shapes: list, layer: str | None = None, **columns: list) -> Path:
    geopandas.GeoDataFrame(columns, geometry=shapes, crs=32651).to_file(path, layer=layer)
    return path


def test_the_first_layer_with_polygons_valid_and_flat(tmp_path):
    path = written(tmp_path / "a.gpkg", [Point(0, 0)], "points", kind=["x"])
    written(path, [BOW, shapely.force_3d(box(0, 0, 3, 1), 7.0), None], "drawn", Kind=["a", "b", "c"])
    frame, field = read_polygons(path, "kind", "--class-field")
    assert field == "Kind"
    assert frame["Kind"].tolist() == ["a", "b", "c"]
    assert frame.geometry.area.tolist()[:2] == [2.0, 3.0]
    assert frame.geometry.is_valid.tolist()[:2] == [True, True]
    assert not frame.geometry.has_z.any()
    assert frame.geometry[2] is None
    assert frame.crs.to_epsg() == 32651


def test_the_name_with_the_same_letters_is_taken_before_one_of_another_case(tmp_path):
    path = written(tmp_path / "a.geojson", [box(0, 0, 1, 1)], Kind=["a"], kind=["b"])
    frame, field = read_polygons(path, "kind", "--class-field")
    assert frame[field].tolist() == ["b"]


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda path: path, "The polygons .* do not exist; check their path."),
        (lambda path: written(path, [Point(0, 0)], kind=["x"]), "holds no polygons; give a layer of polygons with"),
        (lambda path: path.write_text("no vector file"), "cannot be read; give them as GeoPackage"),
        (
            lambda path: written(path, [box(0, 0, 1, 1)], other=["x"]),
            r"have no field kind; name the one to take by --class-field \(there are other\)\.",
        ),
    ],
)
def test_what_cannot_be_used_is_one_sentence_with_the_remedy(tmp_path, make, words):
    path = tmp_path / "a.gpkg"
    make(path)
    with pytest.raises(InputError, match=words):
        read_polygons(path, "kind", "--class-field")
