"""Manifests: tables, layers and folders into slopes, and what is wrong with their rows."""

from __future__ import annotations

import os
from datetime import date
from pathlib import Path

import geopandas
import pytest
import shapely
from slopewatch.engine.core.errors import InputError
from slopewatch.engine.vector.area import read_roi
from slopewatch.workflows.batch.folder_names import folder_name
from slopewatch.workflows.batch.jobs import Corridor
from slopewatch.workflows.batch.manifest import read_manifest


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    for name in ("a1.laz", "a2.laz", "b1.laz", "roi.gpkg", "line.gpkg"):
        (tmp_path / name).write_bytes(b"x")
    return tmp_path


def corridor(folder: Path, text: str) -> Corridor:
    (folder / "m.csv").write_text(text, encoding="utf-8")
    return read_manifest(folder / "m.csv", folder / "regions")


def test_rows_become_slopes_with_their_surveys_in_order(folder: Path) -> None:
    found = corridor(
        folder,
        "Slope,date,file,roi,centreline,cell,adaptive,profile,owner\n"
        "A,2025-05-01,a2.laz,roi.gpkg,line.gpkg,0.5,no,,me\n"
        f"A,2024-05-01,{folder}/a1.laz,,,,,paper,\n"
        "B,2024-05-01,b1.laz,,,auto,,,\n",
    )
    first, second = found.slopes
    assert found.problems == ()
    assert [(s.day, s.cloud) for s in first.surveys] == [
        (date(2024, 5, 1), folder / "a1.laz"), (date(2025, 5, 1), folder / "a2.laz"),
    ]  # fmt: skip
    assert (first.roi, first.centreline, first.profile) == (folder / "roi.gpkg", folder / "line.gpkg", "paper")
    assert dict(first.options) == {"cell": 0.5, "adaptive": False}
    assert (second.name, second.roi, dict(second.options)) == ("B", None, {"cell": "auto"})
    assert found.notes == ("The columns owner of the manifest are no settings and are left out.",)


@pytest.mark.parametrize(
    ("row", "words"),
    [
        ("A,0000-05-01,a1.laz,,", "Line 2: '0000-05-01' is not a date"),
        ("A,-044-03-15,a1.laz,,", "is not a date; write it as YYYY-MM-DD."),
        ("A,,a1.laz,,", "Line 2: the date is missing"),
        ("A,2024-05-01,,,", "Line 2: the file is missing"),
        ("A,2024-05-01,gone.laz,,", "gone.laz' does not exist or is no file; correct the path."),
        ("A,2024-05-01," + "x" * 300 + ",,", "does not exist or is no file"),
        ("A,2024-05-01,a1.laz,gone.gpkg,", "Line 2: roi names '"),
        ("A,2024-05-01,a1.laz,,-2", "Line 2: cell is -2.0; give a number from 0.005 to 100 m, or auto."),
        ("A,2024-05-01,a1.laz,,=1+1", "Line 2: cell is '=1+1'; give a number"),
        ("A,2024-05-01,a1.laz,,1,2,3", "Line 2: it has 7 values for 5 columns; quote texts with commas."),
        ("A,2024-05-01,a1.laz,,\nA,2024-05-01,a2.laz,,", "Line 3: Line 2 has another file of 2024-05-01"),
        ("A,2024-05-01,a1.laz,,1\nA,2025-05-01,a2.laz,,2", "Line 3: cell is '2', and '1' on Line 2; give a slope one."),
        ("x" * 101 + ",2024-05-01,a1.laz,,", "has 101 letters; give it at most 100."),
        ("A\tB,2024-05-01,a1.laz,,", "has characters in its name that cannot be shown"),
    ],
)
def test_what_is_wrong_with_a_row_stops_its_slope_only(folder: Path, row: str, words: str) -> None:
    found = corridor(folder, f"slope,date,file,roi,cell\n{row}\nB,2024-05-01,b1.laz,,\n")
    assert [slope.name for slope in found.slopes] == ["B"]
    (problem,) = found.problems
    assert words in problem.sentence
    assert problem.sentence.endswith(".")
    assert "\n" not in problem.sentence
    assert problem.slope.isprintable()


def test_a_row_without_a_slope_is_a_problem_of_none(folder: Path) -> None:
    found = corridor(folder, "slope,date,file,roi\n,2024-05-01,a1.laz,\nB,2024-05-01,b1.laz,\n")
    assert [(p.slope, p.sentence) for p in found.problems] == [("", "Line 2: the slope is not named; give it a name.")]
    assert len(found.slopes) == 1


def test_a_row_that_is_there_twice_counts_once(folder: Path) -> None:
    found = corridor(folder, "slope,date,file,roi\nA,2024-05-01,a1.laz,\nA,2024-05-01,a1.laz,\n")
    assert len(found.slopes[0].surveys) == 1
    assert found.notes == ("Line 3 says the same as Line 2 and is left out.",)


def test_names_that_differ_in_capitals_only_would_share_a_folder(folder: Path) -> None:
    found = corridor(folder, "slope,date,file,roi\nA,2024-05-01,a1.laz,\na,2024-05-01,a1.laz,\n")
    assert [slope.name for slope in found.slopes] == ["A"]
    assert "differs from A in capitals only" in found.problems[0].sentence


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (b"", "is empty"),
        (b"slope,date,file,roi\n", "holds no survey"),
        (b"slope,date,roi\nA,2024-05-01,\n", "has no column file; it needs slope, date, file and roi."),
        (b"slope,date,file,FILE\nA,2024-05-01,a,b\n", "has the column file twice"),
        (b"slope,date,file\n\xff\xfe,2024-05-01,a1.laz\n", "is no text in UTF-8"),
        (b"slope,date,file\n\x00A,2024-05-01,a1.laz\n", "is no text in UTF-8"),
    ],
)
def test_a_manifest_that_cannot_be_read_is_an_input_error(folder: Path, data: bytes, words: str) -> None:
    (folder / "m.csv").write_bytes(data)
    with pytest.raises(InputError, match=words):
        read_manifest(folder / "m.csv", folder / "regions")
    assert not (folder / "regions").exists()


@pytest.mark.parametrize("name", ["gone.csv", "a1.laz", "roi.gpkg", "empty"])
def test_what_is_no_manifest_is_named(folder: Path, name: str) -> None:
    (folder / "empty").mkdir()
    with pytest.raises(InputError, match=name):
        read_manifest(folder / name, folder / "regions")


def test_polygons_of_a_layer_are_the_regions(folder: Path) -> None:
    shapes = [shapely.box(500_000 + 20 * n, 3_500_000, 500_010 + 20 * n, 3_500_010) for n in range(2)]
    columns = {
        "SLOPE": ["A", "A", "B"],
        "date": ["2024-05-01", "2025-05-01", "2024-05-01"],
        "file": ["a1.laz", "a2.laz", "b1.laz"],
        "minimum_cells": [3.0, None, None],
    }
    frame = geopandas.GeoDataFrame(columns, geometry=[shapes[0], shapes[0], shapes[1]], crs=32651)
    frame.to_file(folder / "m.gpkg", layer="slopes")
    found = read_manifest(folder / "m.gpkg", folder / "regions")
    assert found.problems == ()
    assert [(s.name, len(s.surveys)) for s in found.slopes] == [("A", 2), ("B", 1)]
    assert dict(found.slopes[0].options) == {"minimum_cells": 3}
    for slope, shape in zip(found.slopes, shapes, strict=True):
        assert slope.roi is not None
        assert read_roi(slope.roi, frame.crs).geometry.equals(shape)
    before = found.slopes[0].roi.stat().st_mtime_ns
    assert read_manifest(folder / "m.gpkg", folder / "regions") == found
    assert found.slopes[0].roi.stat().st_mtime_ns == before, "a task's id would not be found again as quickly"


def test_a_ring_that_is_not_closed(folder: Path) -> None:
    ring = "[[0,0],[1,0],[1,1],[0,0.5]]"
    shape = f'{{"type": "Polygon", "coordinates": [{ring}]}}'
    values = '{"slope": "A", "date": "2024-05-01", "file": "a1.laz"}'
    feature = f'{{"type": "Feature", "properties": {values}, "geometry": {shape}}}'
    (folder / "m.geojson").write_text(f'{{"type": "FeatureCollection", "features": [{feature}]}}')
    with pytest.raises(InputError, match="cannot be read as a vector file"):
        read_manifest(folder / "m.geojson", folder / "regions")


def test_a_line_is_no_region(folder: Path) -> None:
    line = shapely.LineString([(0, 0), (1, 1)])
    columns = {"slope": ["A"], "date": ["2024-05-01"], "file": ["a1.laz"]}
    geopandas.GeoDataFrame(columns, geometry=[line], crs=32651).to_file(folder / "m.gpkg")
    found = read_manifest(folder / "m.gpkg", folder / "regions")
    assert found.slopes == ()
    assert "its shape is a LineString; draw the slope as a polygon." in found.problems[0].sentence


def test_a_folder_of_folders(folder: Path) -> None:
    for name in ("A/2024-05-01.laz", "A/2025-05-01.las", "A/roi.gpkg", "B/unknown.laz", "C/notes.txt"):
        path = folder / "slopes" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(b"x")
    found = read_manifest(folder / "slopes", folder / "regions")
    (slope,) = found.slopes
    assert [s.day for s in slope.surveys] == [date(2024, 5, 1), date(2025, 5, 1)]
    assert slope.roi == folder / "slopes" / "A" / "roi.gpkg"
    assert {p.slope: p.sentence for p in found.problems} == {
        "B": "Folder 'B': the name of 'unknown.laz' does not hold exactly one date; rename it.",
        "C": "Folder 'C': it holds no LAS or LAZ file; give its surveys.",
    }


@pytest.mark.skipif(os.name != "posix", reason="other systems' names are always text")
def test_names_that_are_no_unicode_can_be_shown(folder: Path) -> None:
    cloud = os.fsencode(folder / "slopes") + b"/\xff/2024-05-01.laz"
    os.makedirs(os.path.dirname(cloud))
    with open(cloud, "wb"):
        pass
    (slope,) = read_manifest(folder / "slopes", folder / "regions").slopes
    assert slope.name == "\\udcff"
    assert slope.surveys[0].cloud.is_file()


@pytest.mark.parametrize(
    "name", ["../up", "a/b", "CON", "=1+1", "<b>", " ", "..", "Hang 3", "斜面", "x" * 100, ".hidden", "-x", "a."]
)
def test_folders_of_slopes_are_safe_everywhere(name: str) -> None:
    folder = folder_name(name)
    assert Path(folder).name == folder
    assert folder.strip("._- ") == folder
    assert folder.isascii()
    assert folder.lower() not in ("con", "nul")
    assert len(folder) <= 60
    assert folder != folder_name(f"{name}x")
    assert folder_name("S1-a_2.b") == "S1-a_2.b"
