"""Corrections by hand as people give them: read, cut to the slope, and refused."""

from __future__ import annotations

import math
from datetime import date

import geopandas
import pytest
from pyproj import CRS
from shapely import Point, box
from slopewatch.engine.core.errors import InputError
from slopewatch.engine.vector.corrections import OutsideError, read_corrections

UTM = CRS.from_epsg(32651)
HEAP, BUSH, CAR = box(0, 0, 10, 5), box(20, 0, 24, 4), box(40, 0, 42, 4)


def written(folder, rows, shapes, crs=32651, name="corrections.gpkg"):
    path = folder / name
    geopandas.GeoDataFrame(rows, geometry=shapes, crs=crs).to_file(path)
    return path


@pytest.mark.parametrize("name", ["corrections.gpkg", "corrections.shp", "corrections.geojson"])
def test_fields_and_areas_are_read_from_every_format(tmp_path, name):
    rows = {
        "Action": ["exclude", "GROUND", "not_ground"],
        "reason": ["heap", None, "car"],
        "epoch": [None, "2024-05-01", ""],
    }
    path = written(tmp_path, rows, [HEAP, BUSH, CAR], name=name)
    found, notes = read_corrections(path, UTM)
    # GeoJSON is in degrees, of which a coordinate keeps about 1e-7, a centimetre
    areas = [area.shape.area for area in found.areas]
    assert areas == pytest.approx([50.0, 16.0, 8.0], rel=0.01 if name.endswith("geojson") else 1e-9)
    assert [(a.action, a.reason, a.day) for a in found.areas] == [
        ("exclude", "heap", None),
        ("ground", "", date(2024, 5, 1)),
        ("not_ground", "car", None),
    ]
    assert len(found.of(date(2024, 5, 1)).areas) == 3
    assert [a.action for a in found.of(date(2025, 5, 1)).areas] == ["exclude", "not_ground"]
    facts = found.facts()
    assert (facts["exclude_count"], facts["ground_count"], facts["not_ground_count"]) == (1, 1, 1)
    assert not notes or name.endswith("geojson")


def test_a_field_of_dates_is_a_day(tmp_path):
    path = written(tmp_path, {"action": ["exclude"], "epoch": [date(2024, 5, 1)]}, [HEAP])
    assert read_corrections(path, UTM)[0].areas[0].day == date(2024, 5, 1)


def test_polygons_without_a_system_are_in_the_clouds_own_unit(tmp_path):
    path = written(tmp_path, {"action": ["exclude"]}, [HEAP], crs=None)
    found, notes = read_corrections(path, UTM, unit=0.3048)
    assert found.areas[0].shape.area == pytest.approx(50.0 * 0.3048**2)
    assert "declare no reference system" in notes[0]


def test_areas_that_overlap_count_once_in_their_sum(tmp_path):
    path = written(tmp_path, {"action": ["exclude", "exclude"]}, [Point(0, 0).buffer(3), Point(0, 0).buffer(5)])
    facts = read_corrections(path, UTM)[0].facts()
    assert facts["exclude_area_m2"] == pytest.approx(25 * math.pi, rel=0.01)
    assert sum(row["area_m2"] for row in facts["areas"]) == pytest.approx(34 * math.pi, rel=0.01)


def test_an_area_outside_of_the_slope_is_left_out_and_named(tmp_path):
    found, _ = read_corrections(written(tmp_path, {"action": ["exclude", "ground"]}, [HEAP, CAR]), UTM)
    kept, sentence = found.within(box(-5, -5, 15, 15))
    assert [area.action for area in kept.areas] == ["exclude"]
    assert sentence.startswith("1 of 2 corrections of ")
    assert found.within(box(-5, -5, 50, 15)) == (found, "")
    with pytest.raises(OutsideError, match=r"^No correction of .* lies on the slope; check the reference system"):
        found.within(box(500, 500, 600, 600))


def test_what_is_outside_of_the_excluded_areas(tmp_path):
    found, _ = read_corrections(written(tmp_path, {"action": ["exclude", "not_ground"]}, [HEAP, CAR]), UTM)
    slope = box(-5, -5, 50, 15)
    assert found.outside(slope, "exclude").area == pytest.approx(slope.area - 50)
    assert found.outside(slope, "exclude", "not_ground").area == pytest.approx(slope.area - 58)
    assert found.outside(slope, "ground") is slope
    everywhere = found.outside(None, "exclude")
    assert everywhere.contains(Point(-1000, 3000))
    assert not everywhere.contains(Point(5, 2))


@pytest.mark.parametrize(
    ("rows", "shapes", "words"),
    [
        (
            {"action": ["exclude", "heap"]},
            [HEAP, CAR],
            "Correction 2 of .* has the action 'heap'; give exclude, ground or not_ground",
        ),
        ({"action": [None]}, [HEAP], "Correction 1 of .* has the action ''"),
        ({"kind": ["exclude"]}, [HEAP], r"have no field action; add it \(there are kind\)"),
        (
            {"action": ["exclude"], "epoch": ["May 2024"]},
            [HEAP],
            "Correction 1 of .* has the epoch 'May 2024'; give the date",
        ),
        ({"action": ["exclude"]}, [Point(0, 0)], "holds no polygons"),
        (
            {"action": ["ground", "not_ground"]},
            [HEAP, HEAP],
            r"The corrections 1 \(ground\) and 2 \(not_ground\) of .* contradict each other on 50.0 m², as at x",
        ),
    ],
)
def test_what_cannot_be_used_is_refused_in_one_sentence(tmp_path, rows, shapes, words):
    path = written(tmp_path, rows, shapes)
    with pytest.raises(InputError, match=words) as refused:
        read_corrections(path, UTM)
    sentence = str(refused.value)
    assert path.name in sentence
    assert sentence.endswith(".")
    assert "\n" not in sentence


def test_what_overlaps_without_contradiction_is_taken(tmp_path):
    days = {"action": ["ground", "not_ground"], "epoch": ["2024-05-01", "2025-05-01"]}
    assert len(read_corrections(written(tmp_path, days, [HEAP, HEAP]), UTM)[0].areas) == 2
    sliver = [HEAP, box(9.5, 0, 20, 5)]
    assert read_corrections(written(tmp_path, {"action": ["ground", "not_ground"]}, sliver), UTM)
    assert read_corrections(written(tmp_path, {"action": ["exclude", "ground"]}, [HEAP, HEAP]), UTM)


def test_a_day_without_a_survey_is_refused(tmp_path):
    rows = {"action": ["exclude"], "epoch": ["2024-06-01"]}
    found, _ = read_corrections(written(tmp_path, rows, [HEAP]), UTM)
    found.refuse_other_days([date(2024, 6, 1)])
    words = r"Correction 1 of .* has the epoch 2024-06-01, but the surveys are 2024-05-01, 2025-05-01; give the date"
    with pytest.raises(InputError, match=words):
        found.refuse_other_days([date(2024, 5, 1), date(2025, 5, 1)])
