"""The matched filter as a method of screening, and what a slope lets anyone find, on slopes with known hazards."""

from __future__ import annotations

import json
from pathlib import Path

import geopandas
import numpy as np
import pytest
from pyproj import CRS
from rasterio import open as open_raster
from slopewatch.engine.core.progress import Progress
from slopewatch.engine.geometry.dominant_plane import apply_matrix
from slopewatch.engine.pointcloud.cloud import PointCloud
from slopewatch.engine.pointcloud.reading import read_cloud
from slopewatch.interface.parameters import ScreeningParameters
from slopewatch.models.preparation.even_scores import even_scores
from slopewatch.models.preparation.raster_zones import Scores, zones_above
from slopewatch.models.preparation.relief_raster import relief_raster
from slopewatch.models.screening.detectability import PARTS, Detectability, detectability
from slopewatch.models.screening.filter import filter_memberships
from slopewatch.tests.builders.screening_clouds import BULGE, HOLLOW, SOUTH, WEST, screen, screen_cloud, slope, write


def rough_slope(height: float, seed: int = 3) -> np.ndarray:
    """The slope of ``slope`` with relief of 1 to 8 m wavelength that scatters by ``height`` m."""
    xyz = slope(20_000, seed=seed)
    rng = np.random.default_rng(seed)
    relief = np.zeros(len(xyz))
    for _ in range(80):
        length, angle, phase = rng.uniform(1, 8), *rng.uniform(0, 2 * np.pi, 2)
        along = (xyz[:, 0] - WEST) * np.cos(angle) + (xyz[:, 1] - SOUTH) * np.sin(angle)
        relief += np.sqrt(2 / 80) * np.sin(2 * np.pi * along / length + phase)
    xyz[:, 2] += height * relief
    return xyz


@pytest.fixture(scope="module")
def cloud(tmp_path_factory) -> Path:
    return write(tmp_path_factory.mktemp("slope") / "2024-05-01.laz", slope())


@pytest.fixture(scope="module")
def rough(tmp_path_factory) -> Path:
    return write(tmp_path_factory.mktemp("rough") / "2024-05-01.laz", rough_slope(1.2))


def test_the_filter_finds_the_bulge_and_the_hollow(cloud, tmp_path):
    done = screen(cloud, tmp_path / "out.laz", method="filter")
    zones = geopandas.read_file(done.outputs["zones"], layer="zones").set_index("kind")
    assert sorted(zones.index) == ["subsidence", "uplift"]
    for kind, place in (("uplift", BULGE), ("subsidence", HOLLOW)):
        centre = zones.loc[kind].geometry.centroid
        assert np.hypot(centre.x - WEST - place[0], centre.y - SOUTH - place[1]) < 0.8
        assert 2.0 < zones.loc[kind]["area_m2"] < 20.0
        assert zones.loc[kind]["confidence"] != "high"
    assert set(zones["method"]) == {"filter"}
    record = json.loads(done.outputs["run"].read_text())
    assert record["model"]["name"] == "filter"
    assert "to be found by screening (" in record["detectable"]


def test_on_sparse_ground_the_zones_have_no_holes(tmp_path):
    sparse = write(tmp_path / "sparse.laz", slope(1500))  # 3 points a m²
    done = screen(sparse, tmp_path / "out.laz", method="filter")
    zones = geopandas.read_file(done.outputs["zones"], layer="zones").set_index("kind")
    assert sorted(zones.index) == ["subsidence", "uplift"]
    assert zones["area_m2"].between(3.0, 20.0).all()
    assert all(len(part.interiors) == 0 for zone in zones.geometry for part in zone.geoms)


def test_fewer_accepted_false_zones_need_a_higher_level_and_higher_hazards(cloud, tmp_path):
    few, many = (
        screen(cloud, tmp_path / f"{accepted}.laz", method="filter", false_zones=accepted) for accepted in (0.1, 10.0)
    )
    assert few.figures["zone_area_m2"] < many.figures["zone_area_m2"]
    heights = [done.figures["smallest_hazard_m"]["3"]["median"] for done in (few, many)]
    assert heights[0] > 2 * heights[1]


def test_memberships_say_how_far_the_score_passes_the_level():
    level = 1.8
    score = level * np.array([[0.0, 0.5, 1.0, 1.5, 2.0, np.nan]])
    up, down = (filter_memberships(Scores(*both, 0.5), level) for both in ((score, -score), (-score, score)))
    assert up.sum(axis=0) == pytest.approx(1.0, abs=1e-6)
    np.testing.assert_allclose(up[1, 0], [0.018, 0.119, 0.5, 0.881, 0.982, 0.0], atol=1e-3)
    np.testing.assert_array_equal(down[[0, 2, 1]], up)
    assert up[0, 0, -1] == 1


def test_labels_are_the_zones_of_the_scores(cloud):
    """Neither a membership nor the grid of the map takes a cell into a zone or out of it."""
    points = read_cloud(cloud)
    screening, _ = screen_cloud(points, ScreeningParameters(screening_method="filter", false_zones=10.0))
    flat = apply_matrix(screening.voxels.matrix, screening.points)
    raster = relief_raster(flat, number=screening.count)
    scores = even_scores(raster)
    i, j = raster.index(flat)
    level = screening.model["level"]
    up, down = (zones_above(score, level, raster.cell)[0][i, j] > 0 for score in (scores.uplift, scores.subsidence))
    assert up.any()
    assert down.any()
    np.testing.assert_array_equal(screening.labels > 0, up | down)
    labels, _ = screening.at(points.xyz)
    np.testing.assert_array_equal(labels, screening.labels[screening.voxels.lookup(points.xyz)])


def test_the_raster_of_smallest_hazards_is_what_the_sentence_says(cloud, tmp_path):
    done = screen(cloud, tmp_path / "out.laz")
    assert done.outputs["smallest_hazard"] == tmp_path / "out_smallest_hazard.tif"
    with open_raster(done.outputs["smallest_hazard"]) as raster, open_raster(done.outputs["probability"]) as other:
        assert raster.count == 4
        assert raster.descriptions[1] == "Height that a hazard 3 m wide needs"
        assert set(raster.units) == {"m"}
        assert (raster.transform, raster.shape, raster.nodata) == (other.transform, other.shape, -9999.0)
        bands = raster.read(masked=True)
        screened = ~other.read(1, masked=True).mask
    assert not (~bands.mask[1] & ~screened).any()
    figures = done.figures["smallest_hazard_m"]
    assert list(figures) == ["2", "3", "5", "8"]
    assert np.ma.median(bands[1]) == pytest.approx(figures["3"]["median"], rel=0.1)
    assert 0.003 < figures["3"]["median"] < 0.05  # 1 cm of noise at 80 points a m²
    style = (tmp_path / "out_smallest_hazard.qml").read_text()
    assert 'band="2"' in style
    record = json.loads(done.outputs["run"].read_text())
    assert f"must stand {figures['3']['median']:.2f} m out of or below the ground around it" in record["detectable"]
    assert "a matched filter" in record["detectable"]


@pytest.mark.parametrize("method", ["filter", "residual"])
def test_where_nothing_can_be_found_no_zones_are_shown(rough, tmp_path, method):
    progress = Progress()
    done = screen(rough, tmp_path / "out.laz", ground="as_is", method=method, progress=progress)
    assert done.figures["blind_share"] > 0.85
    assert done.figures["zone_count"] == done.figures["uplift_points"] == done.figures["subsidence_points"] == 0
    assert len(geopandas.read_file(done.outputs["zones"], layer="zones")) == 0
    record = json.loads(done.outputs["run"].read_text())
    (sentence,) = [w for w in progress.warnings if "gets no zones" in w]
    assert f"on {100 * done.figures['blind_share']:.0f} % of it" in sentence
    assert record["not_shown"] == sentence
    with open_raster(done.outputs["probability"]) as raster:
        assert raster.read(1, masked=True).max() > (0.9 if method == "residual" else 0.05)  # the probabilities stay


def test_zones_of_rough_ground_are_shown_where_asked_for(rough, tmp_path):
    done = screen(rough, tmp_path / "out.laz", ground="as_is", any_relief=True)
    assert done.figures["zone_count"] > 0
    assert any("gets zones that say little" in warning for warning in done.warnings)
    assert "not_shown" not in json.loads(done.outputs["run"].read_text())


def test_the_same_hazards_are_needed_whether_points_come_whole_or_in_voxels():
    """Averages in quarters of the raster's cells stand for their points."""
    rng = np.random.default_rng(5)
    flat = np.column_stack([rng.uniform(0, 30, (30_000, 2)), rng.normal(0, 0.03, 30_000)])
    flat[:, 2] += 0.1 * np.sin(flat[:, 0]) * np.sin(flat[:, 1] / 1.3)
    cloud = PointCloud(
        np.column_stack([flat[:, 0], flat[:, 1] * 0.8 - flat[:, 2] * 0.6, flat[:, 1] * 0.6 + flat[:, 2] * 0.8]),
        CRS.from_epsg(32651), Path("a.laz"),
    )  # fmt: skip
    screening, _ = screen_cloud(cloud, ScreeningParameters(screening_method="residual", ground="as_is"))
    whole = detectability(relief_raster(flat), flat, 1.0)
    assert screening.detectable.medians == pytest.approx(whole.medians, rel=0.15)


def made(*figures, method="filter") -> Detectability:
    width = len(figures[0])
    return Detectability((2.0, 3.0)[-width:], np.ones((width, 4), np.float32), 1.0, *figures, method)


def test_what_cannot_be_said_is_not_said():
    nothing = made(*np.full((2, 2), np.nan), np.nan)
    assert nothing.shown
    assert not nothing.doubtful
    assert "cannot be said" in nothing.sentence()
    half = [made(np.array([1.1]), np.array([0.6]), 0.6, method=name) for name in ("filter", "network", "relief")]
    assert all(one.doubtful for one in half)
    assert [one.shown for one in half] == [False, True, True]
    some = np.array([0.9, 0.3]), np.array([0.4, 0.1]), 0.12
    assert made(*some, method="residual").sentence() == (
        "On half of this slope a hazard 3 m wide must stand 0.30 m out of or below the ground around it to be found by "
        "a matched filter (2 m: 0.90 m). On 12 % of it even 1 m is not enough."
    )
    everywhere = made(np.array([0.9, 0.3]), np.array([0.0, 0.0]), 0.004, method="residual").sentence()
    assert everywhere.endswith("to be found by a matched filter (2 m: 0.90 m).")
    for method in ("relief", "network"):
        assert "to be found by screening (2 m" in made(*some, method=method).sentence()


def test_a_method_of_its_own_needs_its_own_heights(monkeypatch):
    monkeypatch.setitem(PARTS, "relief", {2.0: 0.5, 8.0: 2.0})
    rng = np.random.default_rng(5)
    flat = np.column_stack([rng.uniform(0, 30, (9000, 2)), rng.normal(0, 0.05, 9000)])
    raster = relief_raster(flat)
    plain, own = (detectability(raster, flat, 1.0, method) for method in ("filter", "relief"))
    np.testing.assert_allclose(own.medians / plain.medians, [0.5, 0.75, 1.25, 2.0], rtol=1e-5)
    known = np.isfinite(plain.heights[3])
    np.testing.assert_allclose(own.heights[3][known], 2 * plain.heights[3][known], rtol=1e-5)
    np.testing.assert_array_equal(detectability(raster, flat, 1.0, "residual").medians, plain.medians)
