"""Sheets of screened zones: shares and heights against points whose labels and bumps are known."""

from __future__ import annotations

from datetime import date
from pathlib import Path

import geopandas as gpd
import laspy
import numpy as np
import pytest
from shapely.geometry import Point
from slopewatch.engine.report.signed import screened_ground as reading
from slopewatch.engine.report.signed.blocks import Document
from slopewatch.engine.report.signed.details import Details
from slopewatch.engine.report.signed.page_words import PageWords
from slopewatch.engine.report.signed.screened_ground import screened_ground
from slopewatch.engine.report.signed.screened_sheets import screened_sheets
from slopewatch.engine.report.signed.source import Source
from slopewatch.engine.report.signed.typesetting import typeset
from slopewatch.tests.builders.signed_folder import Pages

MIDDLES, RADIUS, BUMP, NOISE = ((6.0, 10.0), (14.0, 10.0), (10.0, 4.0)), 2.0, 0.25, 0.01
HEAD = {"title": "t", "authors": [], "running": "r", "foot": "f", "page": ["Page ", " of ", ""]}


def labelled(path: Path, points: int = 30_000, seed: int = 1) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A curved slope with flat-topped bumps of ``BUMP``, the second lowered; of each bump 80 % have its label."""
    rng = np.random.default_rng(seed)
    xy = rng.uniform(0, 20, (points, 2))
    z = 0.6 * xy[:, 1] - 0.01 * xy[:, 0] ** 2 + rng.normal(0, NOISE, points)
    labels = np.zeros(points, dtype=np.uint8)
    over = np.zeros(points)
    for number, middle in enumerate(MIDDLES):
        sign = -1.0 if number == 1 else 1.0
        within = np.hypot(*(xy - middle).T) < RADIUS
        over[within] = sign * BUMP
        labels[within & (rng.random(points) < 0.8)] = 2 if sign < 0 else 1
    header = laspy.LasHeader(point_format=6, version="1.4")
    header.scales = [0.001] * 3
    header.add_extra_dim(laspy.ExtraBytesParams(reading.LABELS, np.uint8))
    las = laspy.LasData(header)
    las.x, las.y, las.z = xy[:, 0], xy[:, 1], z + over
    las[reading.LABELS] = labels
    las.write(path)
    return xy, labels, over


def source_of(folder: Path, count: int) -> Source:
    shapes = [Point(middle).buffer(RADIUS) for middle in MIDDLES][:count]
    columns = {
        "zone_id": [f"H{n + 1:03d}" for n in range(count)],
        "kind": ["subsidence" if n == 1 else "uplift" for n in range(count)], "confidence": ["high"] * count,
        "probability": [0.9] * count, "height_med_m": [0.25] * count, "height_p95_m": [0.3] * count,
        "area_m2": [14.0] * count, "slope_deg": [31.0] * count, "points": [900] * count,
    }  # fmt: skip
    screened = gpd.GeoDataFrame(columns, geometry=shapes)
    record = {"command": "inspect", "outputs": {"screened": "screened.laz"}, "metrics": {}, "inputs": []}
    empty = gpd.GeoDataFrame({"zone_id": []}, geometry=[])
    return Source(folder, record, PageWords(), Details({}, ("2025",)), empty, screened, {}, {}, ("2025",))


def test_shares_and_heights_are_those_of_the_points(tmp_path: Path) -> None:
    xy, labels, over = labelled(tmp_path / "screened.laz")
    zones = [Point(middle).buffer(RADIUS - 0.1) for middle in MIDDLES]
    found = screened_ground(tmp_path / "screened.laz", zones)
    assert found is not None
    for number, (ground, middle) in enumerate(zip(found, MIDDLES, strict=True)):
        own = np.hypot(*(xy - middle).T) < RADIUS - 0.1
        label = 2 if number == 1 else 1
        assert ground.share(label) == pytest.approx((labels[own] == label).mean(), abs=0.01)
        assert ground.share(3 - label) == 0.0
        rest = ground.over_trend()
        # the reading rounds to a millimetre, the trend is fitted to a few thousand points with 1 cm of noise
        assert np.median(rest[ground.inside]) == pytest.approx(over[own].mean(), abs=0.02)


def test_chunks_large_clouds_and_other_files_are_read_as_they_should_be(tmp_path: Path, monkeypatch) -> None:
    labelled(tmp_path / "screened.laz", points=5000)
    zones = [Point(MIDDLES[0]).buffer(1.0)]
    whole = screened_ground(tmp_path / "screened.laz", zones)
    monkeypatch.setattr(reading, "_CHUNK", 700)
    parts = screened_ground(tmp_path / "screened.laz", zones)
    assert whole is not None
    assert parts is not None
    np.testing.assert_array_equal(whole[0].points, parts[0].points)
    monkeypatch.setattr(reading, "MAX_POINTS", 4999)
    assert screened_ground(tmp_path / "screened.laz", zones) is None
    (tmp_path / "bad.laz").write_bytes(b"no cloud")
    assert screened_ground(tmp_path / "bad.laz", zones) is None


@pytest.mark.parametrize(("count", "with_cloud"), [(1, True), (3, True), (2, False)])
def test_two_zones_share_a_page_and_no_page_is_half_empty(tmp_path: Path, count: int, with_cloud: bool) -> None:
    if with_cloud:
        labelled(tmp_path / "screened.laz", points=8000)
    document = Document()
    document.blocks = screened_sheets(document, source_of(tmp_path, count))
    assert len(document.blocks) == (count + 1) // 2
    typeset(document, HEAD, date(2026, 11, 23), tmp_path / "a.pdf")
    pages = Pages(tmp_path / "a.pdf")
    assert len(pages.texts) == (count + 1) // 2
    assert "Screened zone H001: uplift, high" in pages.texts[0]
    assert ("Points labelled raised 8" in pages.texts[0]) == with_cloud  # 80 % of them, by lot
    assert ("Section A–A′ through H001" in pages.texts[0]) == with_cloud
    if with_cloud:
        assert min(pages.lowest_ink) >= 0.5
