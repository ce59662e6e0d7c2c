"""What fuzzing found, each as the smallest file that showed it: refused in one sentence, or done right."""

from __future__ import annotations

import contextlib
import copy
import json
import struct
import sys
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rasterio
from PIL import Image
from pyproj import CRS
from rasterio.transform import from_origin
from slopewatch.cli.reporting import say_of_formats
from slopewatch.engine.core.errors import InputError
from slopewatch.engine.core.json_shapes import LARGEST, MisfitError, fields, number, parse_json, rows
from slopewatch.engine.core.progress import Progress
from slopewatch.engine.epochs.epoch import parse_date
from slopewatch.engine.epochs.manifest import read_manifest
from slopewatch.engine.geometry.rigid_transform import RigidTransform
from slopewatch.engine.grid.geotiff import read_raster
from slopewatch.engine.report.embedding import photograph
from slopewatch.engine.report.maps import densities
from slopewatch.engine.report.record_shape import inside, run_record
from slopewatch.engine.report.reviews import zone_reviews
from slopewatch.engine.series.alerts import DEFAULT_TABLE, read_alerts
from slopewatch.engine.vector.area import read_roi
from slopewatch.engine.zones.profiles import read_profiles
from slopewatch.lab.fuzz.readers import RECORD
from slopewatch.models.configuration import SMOKE, ModelConfiguration
from slopewatch.tests.builders.program import run
from slopewatch.tests.builders.screening_clouds import small_weights


def changed(*path: Any, value: Any) -> dict[str, Any]:
    """The sound record with another value at a place; nothing there where the value is Ellipsis."""
    record = copy.deepcopy(RECORD)
    place: Any = record
    for key in path[:-1]:
        place = place[key]
    if value is ...:
        del place[path[-1]]
    else:
        place[path[-1]] = value
    return record


HEIGHTS = ("stages", 0, "epochs", "e", "cover", "heights")
RECORDS = [
    (changed("distribution", "compared", value=...), "distribution.compared"),
    (changed("distribution", "stable", value=[1, 2]), "distribution"),
    (changed("distribution", "bin_m", value=0), "distribution.bin_m"),
    (changed("stable_ground", "nmad_m", value=...), "stable_ground.nmad_m"),
    (changed("stages", value=1), "stages"),
    (changed("stages", 0, value="x"), "stages[0]"),
    (changed(*HEIGHTS, "above", value="x"), "heights.above"),
    (changed(*HEIGHTS, "ground", value=[1]), "heights"),
    (changed("parameters", "change", value="x"), "parameters.change"),
    (changed("epochs", value=[1, 2]), "epochs[0]"),
    (changed("epochs", value=RECORD["epochs"][:1]), "epochs"),
    (changed("epochs", 0, "date", value="0000-01-01"), "epochs[0].date"),
    (changed("profiles", 0, "length_m", value=-1), "profiles[0].length_m"),
    (changed("profiles", 0, "dz_max_m", value=None), "profiles[0].dz_max_m"),
    (changed("volumes", "rows", 0, "unit", value=[]), "volumes.rows[0].unit"),
    (changed("zones", 0, "zone_id", value={}), "zones[0].zone_id"),
    (changed("metrics", "zone_count", value="many"), "metrics.zone_count"),
    (changed("level", "median_m", value=1e308), "level.median_m"),
    (changed("seconds", value=10**400), "seconds"),
    (changed("outputs", "zones", value=1), "outputs.zones"),
    ([], "it"),
    (None, "it"),
]


@pytest.mark.parametrize(("record", "place"), RECORDS, ids=[place for _, place in RECORDS])
def test_a_record_of_another_shape_names_the_place(record: Any, place: str) -> None:
    with pytest.raises(MisfitError) as caught:
        run_record(record)
    assert place in str(caught.value).partition(" is not ")[0]


def test_the_sound_record_fits() -> None:
    run_record(RECORD)


@pytest.mark.parametrize(
    "data", [b"", b"[" * 100_000, b'{"a": NaN}', b'{"a": 1e999}', b'{"a": ' + b"9" * 5000 + b"}", b"\xff\xfe{}", b"{"]
)
def test_text_that_is_no_usable_json(data: bytes) -> None:
    shape = fields({"a": number()})
    with pytest.raises(ValueError, match=r"^it|a is not") as caught:
        shape(parse_json(data), "")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("value", [True, "1", None, float("nan"), float("inf"), 2 * LARGEST, [1]])
def test_what_is_no_number(value: Any) -> None:
    with pytest.raises(MisfitError, match="x is not a number"):
        number()(value, "x")
    with pytest.raises(MisfitError, match=r"x is not a list of at least 2"):
        rows(number(), 2)([1], "x")


@pytest.mark.parametrize("name", ["../a.png", "/etc/passwd", "a/../../b", "", "..\\a", "a\0b"])
def test_a_name_that_leads_out_of_the_folder(tmp_path: Path, name: str) -> None:
    assert inside(tmp_path, name) is None
    assert inside(tmp_path, "clouds/a..b.laz") == tmp_path / "clouds" / "a..b.laz"


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("matrix", [[float("nan")] * 4] * 4), ("matrix", [[1e308] * 4] * 4), ("matrix", [1, 2]), ("matrix", "x"),
        ("centre", [0, 0]), ("centre", {"x": 1}), ("rotation", [[1]]), ("translation", None), ("pieces", []),
        ("pieces", {"west": 0, "south": 0, "spacing": 1, "heights": [[0, 0], [0]], "standard_errors": [[0, 0]] * 2}),
        ("registration", [1]), ("registration", {"unobservable": 3}),
    ],
)  # fmt: skip
def test_a_transform_that_is_none(tmp_path: Path, field: str, value: Any) -> None:
    document = {
        "matrix": np.eye(4).tolist(),
        "centre": [0, 0, 0],
        "rotation": np.eye(3).tolist(),
        "translation": [0] * 3,
    }
    path = tmp_path / "t.json"
    path.write_text(json.dumps(document), encoding="utf-8")
    RigidTransform.load(path)
    path.write_text(json.dumps(document | {field: value}), encoding="utf-8")
    with pytest.raises(InputError, match=r"t\.json.*transform.*; give a transform\.json") as caught:
        RigidTransform.load(path)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    "text",
    ["0000-01-01", "0001-01-01", "9999-12-31", "2024-W18", "20240501", "2024-02-30", "٢٠٢٤-٠٥-٠١", "", "x" * 9999],
)
def test_days_of_no_survey(text: str) -> None:
    with pytest.raises(InputError) as caught:
        parse_date(text)
    assert len(str(caught.value)) < 200


def test_names_that_no_file_can_have(tmp_path: Path) -> None:
    manifest = tmp_path / "m.csv"
    manifest.write_text(f"date,path\n2024-05-01,{'a' * 5000}\n", encoding="utf-8")
    with pytest.raises(InputError, match="Line 2 of the manifest"):
        read_manifest(manifest)
    for words in (("info", "a" * 5000), ("series", "a" * 5000, "--output-dir", tmp_path / "o"), ("report", "a" * 5000)):
        done = run(*words)
        assert done.returncode == 2, done.stderr
        assert len(done.stderr) < 6000


def test_a_value_of_endless_length_is_cut_in_the_message(tmp_path: Path) -> None:
    table = DEFAULT_TABLE.read_text(encoding="utf-8").splitlines()
    cells = table[1].split(",")
    cells[table[0].split(",").index("single_volume_m3")] = "a" * 70_000
    path = tmp_path / "alerts.csv"
    path.write_text("\n".join([table[0], ",".join(cells)]) + "\n", encoding="utf-8")
    with pytest.raises(InputError, match=r"single_volume_m3 is 'aaa.*; give") as refused:
        read_alerts(path)
    assert len(str(refused.value)) < 500


def test_an_endless_number_in_the_alert_table(tmp_path: Path) -> None:
    table = tmp_path / "a.csv"
    table.write_text(DEFAULT_TABLE.read_text(encoding="utf-8").replace("\n1,", "\n1e400,"), encoding="utf-8")
    with pytest.raises(InputError, match="level is '1e400'"):
        read_alerts(table)


@pytest.mark.parametrize(
    "change",
    [
        {"window": {}}, {"widths": "x"}, {"widths": [7, 8]}, {"widths": [10**6]}, {"interpolation": "x"},
        {"neighbours": 10**9}, {"voxel": 1e-30}, {"least_peak": 10**400}, {"trends": [[1]]}, {"features": ["residuals"],
        "trends": []}, {"classes": ["a", "b", "c"]}, {"density": [5, 1]}, {"align": 1}, {"step": float("nan")},
    ],
    ids=str,
)  # fmt: skip
def test_a_model_of_senseless_settings(change: dict[str, Any]) -> None:
    values = json.loads(SMOKE.to_json())
    assert ModelConfiguration.from_mapping(values) == SMOKE
    with pytest.raises(InputError, match=r"[Mm]odel"):
        ModelConfiguration.from_mapping(values | change)


@pytest.mark.parametrize("value", [float("nan"), float("-inf")])
def test_weights_that_are_no_numbers(tmp_path: Path, value: float) -> None:
    weights = small_weights(tmp_path / "w.safetensors")
    import hashlib

    from slopewatch.models.network.weights import load_model

    data = bytearray(weights.read_bytes())
    data[-4:] = struct.pack("<f", value)
    (length,) = struct.unpack_from("<Q", data)
    for place in range(8 + length, 8 + length + 4000, 4):
        struct.pack_into("<f", data, place, value)
    weights.write_bytes(data)
    description = weights.with_suffix(".json")
    stated = json.loads(description.read_text(encoding="utf-8"))
    description.write_text(json.dumps(stated | {"sha256": hashlib.sha256(data).hexdigest()}), encoding="utf-8")
    with pytest.raises(InputError, match="no number"):
        load_model(weights)


def geotiff(path: Path, **more: Any) -> Path:
    profile = {"driver": "GTiff", "height": 4, "width": 4, "count": 1, "dtype": "float32", "crs": "EPSG:32651"}
    with rasterio.open(path, "w", transform=rasterio.Affine(1, 0, 5e5, 0, -1, 3.5e6), **{**profile, **more}) as target:
        target.write(np.zeros((1, profile["height"], profile["width"]), np.float32))
        target.set_band_unit(1, "metre")
    return path


def test_rasters_that_cannot_be(tmp_path: Path) -> None:
    good = geotiff(tmp_path / "a.tif")
    assert read_raster(good).unit == "metre"
    with pytest.raises(InputError, match="bands"):
        read_raster(good, 2)
    data = good.read_bytes()
    (tmp_path / "a.tif").write_bytes(data.replace(b"metre", b"m\xfftre"))
    with pytest.raises(InputError, match="cannot be read as a raster"):
        read_raster(good)
    huge = tmp_path / "huge.tif"
    with rasterio.open(
        huge,
        "w",
        driver="GTiff",
        height=60_000,
        width=60_000,
        count=1,
        dtype="float32",
        sparse_ok=True,
        tiled=True,
        transform=rasterio.Affine(1, 0, 5e5, 0, -1, 3.5e6),
    ):
        pass
    with pytest.raises(InputError, match="more than its bytes can hold"):
        read_raster(huge)
    other = tmp_path / "a.vrt"
    other.write_text(
        f"<VRTDataset rasterXSize='4' rasterYSize='4'><SourceFilename>{good}</SourceFilename></VRTDataset>"
    )
    with pytest.raises(InputError, match="is not a GeoTIFF"):
        read_raster(other)


def test_pictures_and_tables_of_an_output_folder(tmp_path: Path) -> None:
    picture = tmp_path / "heatmap.png"
    Image.new("RGB", (40, 40), (5, 6, 7)).save(picture)
    assert photograph(picture, "x", 100) is not None
    picture.write_bytes(picture.read_bytes()[:60])
    with pytest.raises(InputError, match=r"heatmap\.png cannot be read as a picture"):
        photograph(picture, "x", 100)
    table = tmp_path / "profiles.csv"
    head = "profile,kind,zone_id,distance_m,x,y,height_from_m,height_to_m,dz_m,level_m,significant\n"
    for row in ("a,given,,1,2,3,4,5,inf,7,1\n", "a,given,,1,2\n", "a,given,,x,2,3,4,5,6,7,1\n"):
        table.write_text(head + row, encoding="utf-8")
        if row.count(",") == 10:
            with pytest.raises(InputError, match="no table of profiles"):
                read_profiles(table)
    layer = tmp_path / "zones.gpkg"
    layer.write_bytes(b"SQLite format 3\0" + bytes(500))
    with pytest.raises(InputError, match=r"zones\.gpkg cannot be read"):
        zone_reviews(layer)


def test_what_gdal_says_in_no_utf_8_is_no_traceback(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(warnings, "showwarning", warnings.showwarning)
    path = tmp_path / "heights.tif"
    size = {"width": 4, "height": 4, "count": 1, "dtype": "float32"}
    with rasterio.open(path, "w", driver="GTiff", transform=from_origin(0.0, 4.0, 1.0, 1.0), **size) as target:
        target.update_tags(EPOCH_FROM="2024-05-01")
    data = path.read_bytes()
    assert data.count(b'name="EPOCH_FROM"') == 1
    path.write_bytes(data.replace(b'name="EPOCH_FROM"', b'\xc2a e="EPOCH_FROM"'))  # an attribute without its sign
    words: list[str] = []
    monkeypatch.setattr(sys, "unraisablehook", lambda lost: words.append(str(lost.exc_value)))
    with contextlib.suppress(InputError):
        read_raster(path)
    assert any("utf-8" in one for one in words), "GDAL's sentence holds the byte"
    monkeypatch.setattr(sys, "unraisablehook", sys.__unraisablehook__)
    say_of_formats(Progress())
    capfd.readouterr()
    with contextlib.suppress(InputError):
        read_raster(path)
    assert "Traceback" not in capfd.readouterr().err


def test_a_corner_beyond_the_earth(tmp_path: Path) -> None:
    ring = [[0.0, 0.0], [1e300, 0.0], [1e300, 1e300], [0.0, 0.0]]
    feature = {"type": "Feature", "properties": {}, "geometry": {"type": "Polygon", "coordinates": [ring]}}
    path = tmp_path / "stable.geojson"
    path.write_text(json.dumps({"type": "FeatureCollection", "features": [feature]}), encoding="utf-8")
    with pytest.raises(InputError, match=r"stable\.geojson' has a corner that is not a number, or lies nowhere"):
        read_roi(path, CRS("EPSG:32651"))


@pytest.mark.parametrize("count", [1e20, -5.0, np.inf])
def test_counts_that_no_cell_has(tmp_path: Path, count: float) -> None:
    with rasterio.open(
        tmp_path / "point_counts.tif", "w", driver="GTiff", height=4, width=4, count=2, dtype="float32",
        crs="EPSG:32651", transform=rasterio.Affine(1, 0, 5e5, 0, -1, 3.5e6),
    ) as target:  # fmt: skip
        target.write(np.full((2, 4, 4), count, np.float32))
    assert len(densities(tmp_path)) == 2  # warnings are errors here
