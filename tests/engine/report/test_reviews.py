"""Reviews as the report shows them."""

from __future__ import annotations

import base64
import io
import json
import re
import struct
import zlib
from pathlib import Path

import pytest
from PIL import Image
from slopewatch.engine.core.errors import InputError
from slopewatch.engine.report import reviews as report_reviews
from slopewatch.engine.report.compose import write_report
from slopewatch.engine.report.reviews import Review, zone_reviews
from slopewatch.engine.series.tables import ZONE_FIELDS
from slopewatch.engine.vector.geopackage import Layer, write_layer, write_layers
from slopewatch.tests.builders.zone_layers import entered, zone_layer
from slopewatch.workflows.products.zones import write_zones


def test_zones_of_which_something_was_said(tmp_path: Path) -> None:
    path = tmp_path / "zones.gpkg"
    assert zone_reviews(path) == {}
    zones = zone_layer([(0, 0, 1, 1)] * 5)
    entered(zones, 1, review_status="confirmed", reviewer=" A. Sato ")
    entered(zones, 2, remarks="crack")
    entered(zones, 3, route="S1")
    zones.loc[4, "review_status"] = ""
    write_zones(path, zones)
    assert zone_reviews(path) == {
        "Z002": Review("Z002", "confirmed", "A. Sato", ""),
        "Z003": Review("Z003", "unreviewed", "", "crack"),
    }
    # of a version that had no remarks
    older = tmp_path / "older.gpkg"
    write_layer(older, zones.drop(columns=["remarks"]), "zones")
    assert list(zone_reviews(older)) == ["Z002"]
    path.write_text("no GeoPackage")
    with pytest.raises(InputError, match=r"zones\.gpkg cannot be read"):
        zone_reviews(path)


def series_folder(folder: Path, count: int) -> Path:
    """The record of a series with ``count`` zones, and their file, of which the first and the last are reviewed."""
    zones = zone_layer([(0, 0, 1, 1)] * count, ids=[f"S{i:03d}" for i in range(count)], fields=ZONE_FIELDS)
    entered(zones, 0, review_status="rejected", reviewer="<b>B. Ito", remarks="a car & more")
    entered(zones, count - 1, review_status="confirmed", reviewer="C. Abe")
    write_zones(folder / "series.gpkg", zones)
    rows = [{"zone_id": zone, "kind": "subsidence", "alert": "none", "trend": "steady"} for zone in zones["zone_id"]]
    record = {
        "software": "SlopeWatch", "command": "series", "started": "2025-01-01", "parameters": {}, "inputs": [],
        "metrics": {"epoch_count": 2, "zone_count": count}, "warnings": [], "outputs": {}, "versions": {},
        "zones": rows,
    }  # fmt: skip
    (folder / "run.json").write_text(json.dumps(record))
    return folder


def test_the_table_shows_a_review_below_its_zone_and_lists_those_of_zones_it_leaves_out(tmp_path: Path) -> None:
    page = " ".join(write_report(series_folder(tmp_path, 60)).read_text(encoding="utf-8").split())
    said = "Review: Rejected by &lt;b&gt;B. Ito. a car &amp; more"
    assert page.index("S000</th>") < page.index(said) < page.index("S001</th>")
    assert page.count('class="review"') == 1
    others = page[page.index("Reviews of the other zones") :]
    assert "S059</th><td" in others
    assert "C. Abe" in others
    assert "B. Ito" not in others


def test_without_reviews_nothing_is_said_of_them(tmp_path: Path) -> None:
    folder = series_folder(tmp_path, 2)
    write_zones(folder / "series.gpkg", zone_layer([(0, 0, 1, 1)], fields=ZONE_FIELDS))
    page = write_report(folder).read_text(encoding="utf-8")
    assert "Review" not in page


def photographed(folder: Path, entered_path: str, **more: str) -> Path:
    """The record and the file of a series of which the first zone has a photo."""
    zones = zone_layer([(0, 0, 1, 1)] * 2, ids=["S000", "S001"], fields=ZONE_FIELDS)
    zones["photo"] = [entered_path, None]
    series_folder(folder, 2)
    write_layers(folder / "series.gpkg", [Layer(entered(zones, 0, **more), "zones", own=("photo", "review_date"))])
    return folder


def camera_picture(path: Path, orientation: int) -> None:
    """A wide picture, its left half red; by its EXIF tag it may have been taken with the camera turned."""
    path.parent.mkdir(exist_ok=True)
    image = Image.new("RGB", (2400, 1600), "blue")
    image.paste("red", (0, 0, 1200, 1600))
    exif = Image.Exif()
    exif[0x0112] = orientation
    exif[0x010E] = "<script>alert(1)</script>"
    image.save(path, exif=exif)


def shown_photo(page: str) -> Image.Image:
    (source,) = re.findall(r'<img class="photo" src="data:image/jpeg;base64,([^"]+)"', page)
    return Image.open(io.BytesIO(base64.b64decode(source)))


@pytest.mark.parametrize(
    ("orientation", "size", "red_at"),
    [(1, (900, 600), (10, 300)), (3, (900, 600), (890, 300)), (6, (600, 900), (300, 10)), (8, (600, 900), (300, 890))],
)
def test_a_photo_is_embedded_small_and_upright(tmp_path, orientation, size, red_at):
    camera_picture(tmp_path / "photos" / "a.jpg", orientation)
    folder = photographed(tmp_path, "photos/a.jpg", review_status="confirmed", reviewer="A. Sato")
    page = write_report(folder).read_text(encoding="utf-8")
    image = shown_photo(page)
    assert image.size == size
    red, _, blue = image.getpixel(red_at)
    assert red > 200 > 100 > blue
    # EXIF 2.32, table 6: what the tag says lies on the side of row 0 and column 0
    assert not image.getexif()
    assert "script" not in page
    assert 'alt="Photo of S000"' in page
    (width, height) = map(int, re.findall(r'<img class="photo".*?width="(\d+)" height="(\d+)"', page)[0])
    assert width / height == pytest.approx(size[0] / size[1], rel=0.01)
    assert (width, height) <= (320, 260)


def test_the_day_of_a_review_is_said(tmp_path):
    zones = {"review_status": "confirmed", "reviewer": "A. Sato", "review_date": "2025-05-02", "remarks": "crack"}
    page = " ".join(write_report(photographed(tmp_path, "", **zones)).read_text(encoding="utf-8").split())
    assert "Review: Confirmed by A. Sato on 2025-05-02. crack" in page


def test_a_zone_with_nothing_but_a_photo_is_listed(tmp_path):
    camera_picture(tmp_path / "photos" / "a.jpg", 1)
    reviews = zone_reviews(photographed(tmp_path, "photos/a.jpg") / "series.gpkg")
    assert list(reviews) == ["S000"]
    assert reviews["S000"].photo is not None


@pytest.mark.parametrize(
    ("name", "why"),
    [
        ("photos/gone.jpg", "is no longer there"),
        ("photos/broken.jpg", "cannot be read as a picture"),
        ("photos/text.jpg", "cannot be read as a picture"),
        ("photos/odd.jpg", "cannot be read as a picture"),
        ("photos", "is no longer there"),
        ("../a.jpg", "lies outside the folder"),
        ("/etc/hostname", "lies outside the folder"),
        ("x" * 5000, "cannot be read as a picture"),
        ('"><script>alert(1)</script>', "is no longer there"),
    ],
)
def test_a_photo_that_cannot_be_shown_is_one_sentence(tmp_path, name, why):
    folder = tmp_path / "results"
    folder.mkdir()
    camera_picture(tmp_path / "a.jpg", 1)
    camera_picture(folder / "photos" / "broken.jpg", 1)
    whole = (folder / "photos" / "broken.jpg").read_bytes()
    (folder / "photos" / "broken.jpg").write_bytes(whole[: len(whole) // 2])
    (folder / "photos" / "text.jpg").write_text("no picture")
    # a directory of tags that points out of the file
    (folder / "photos" / "odd.jpg").write_bytes(b"II*\0\xff\xff\xff\x7f")
    page = write_report(photographed(folder, name, review_status="confirmed")).read_text(encoding="utf-8")
    assert re.search(rf'<span class="unknown">The photo .* {why}[^<]*\.</span>', page)
    assert '<img class="photo"' not in page
    assert "<script" not in page


@pytest.mark.parametrize(("name", "found"), [(".slopewatch-part-x", True), ("results", False)])
def test_a_run_at_work_finds_the_photos_of_its_folder(tmp_path, name, found):
    camera_picture(tmp_path / "photos" / "a.jpg", 1)
    folder = tmp_path / name
    folder.mkdir()
    review = zone_reviews(photographed(folder, "photos/a.jpg") / "series.gpkg")["S000"]
    assert (review.photo is not None) == found


def test_a_report_has_only_so_many_photos(tmp_path, monkeypatch):
    monkeypatch.setattr(report_reviews, "_MAX_PHOTOS", 0)
    camera_picture(tmp_path / "photos" / "a.jpg", 1)
    page = write_report(photographed(tmp_path, "photos/a.jpg")).read_text(encoding="utf-8")
    assert "is left out, because the report has 0 already." in page


def test_a_picture_of_too_many_pixels_is_not_decoded(tmp_path):
    header = struct.pack(">IIBBBBB", 60_000, 60_000, 8, 2, 0, 0, 0)
    chunk = b"IHDR" + header
    (tmp_path / "photos").mkdir()
    (tmp_path / "photos" / "a.png").write_bytes(
        b"\x89PNG\r\n\x1a\n" + struct.pack(">I", 13) + chunk + struct.pack(">I", zlib.crc32(chunk))
    )
    review = zone_reviews(photographed(tmp_path, "photos/a.png") / "series.gpkg")["S000"]
    assert review.photo is None
    assert review.photo_fault == "The photo 'photos/a.png' cannot be read as a picture."
