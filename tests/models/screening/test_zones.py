"""Zones and rasters of screened voxels against arithmetic."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from pyproj import CRS
from slopewatch.engine.core.errors import InputError
from slopewatch.interface.parameters import ScreeningParameters
from slopewatch.models.preparation.raster_zones import Scores
from slopewatch.models.screening.labels import Decision, zone_labels
from slopewatch.models.screening.zones import FIELDS, Hazards, outline_hazards

STEP = 0.125
TAN = 0.75  # the slope rises by so much a metre northwards


def screening(*patches, tan=TAN, skip=None, name="net", spread=0.0, least=0.0):
    """Voxels every 12.5 cm on 12 x 10 m of a plane; each patch is (west, south, east, north, class, P, height)."""
    x, y = (a.ravel() for a in np.meshgrid(np.arange(0, 12, STEP) + STEP / 2, np.arange(0, 10, STEP) + STEP / 2))
    probabilities = np.tile([0.9, 0.05, 0.05], (len(x), 1)).astype(np.float32)
    heights = np.zeros(len(x), dtype=np.float32)
    rng = np.random.default_rng(0)
    for west, south, east, north, kind, probability, height in patches:
        inside = (x > west) & (x < east) & (y > south) & (y < north)
        probabilities[inside] = (1 - probability) / 2
        probabilities[inside, kind] = probability
        heights[inside] = height + spread * rng.normal(size=int(inside.sum()))
    kept = np.ones(len(x), dtype=bool) if skip is None else ~skip(x, y)
    points = np.column_stack([x, y, tan * y])[kept]
    return SimpleNamespace(
        points=points,
        count=np.full(len(points), 3),
        probabilities=probabilities[kept],
        heights=heights[kept],
        labels=Decision().of_voxels(probabilities[kept]),
        plane=SimpleNamespace(dip=np.degrees(np.arctan(tan))),
        bridged=STEP,
        decision=Decision(least),
        method=name if name == "residual" else "network",
        detectable=SimpleNamespace(diameters=(), heights=np.empty((0, len(points)))),
        model={"name": name, **({} if name == "residual" else {"sha256": "ab" * 32})},
    )


def outlined(found, **parameters) -> Hazards:
    return outline_hazards(found, CRS.from_epsg(32651), ScreeningParameters(**parameters), run_id="r1")


def test_figures_of_a_patch():
    zones = outlined(screening((2, 3, 5, 5, 2, 0.9, -0.2), spread=0.05)).frame
    assert list(zones.columns) == [*FIELDS, "geometry"]
    zone = zones.iloc[0]
    assert (zone["class"], zone["kind"], zone["confidence"]) == (2, "subsidence", "high")
    assert zone["plan_m2"] == pytest.approx(6.0)
    assert zone.geometry.area == pytest.approx(6.0)
    assert zone.geometry.bounds == pytest.approx((2, 3, 5, 5))
    assert zone["area_m2"] == pytest.approx(6.0 * np.sqrt(1 + TAN**2), rel=1e-4)
    assert zone["slope_deg"] == pytest.approx(36.87, abs=0.01)
    assert zone["probability"] == pytest.approx(0.9, abs=1e-5)
    assert zone["height_med_m"] == pytest.approx(-0.2, abs=0.01)
    assert zone["height_p95_m"] == pytest.approx(-0.2 - 1.645 * 0.05, abs=0.015)
    assert zone["points"] == 3 * 24 * 16
    assert zone["method"] == "network net abababababab"
    assert (zone["run_id"], zone["review_status"], zone["zone_id"]) == ("r1", "unreviewed", "H001")
    assert zones.crs.to_epsg() == 32651


def test_confidence_follows_the_rule_and_orders_the_zones():
    patches = [
        (0.5, 0.5, 2.5, 2.5, 1, 0.80, 0.2),  # medium
        (0.5, 4.0, 2.5, 6.0, 2, 0.55, -0.2),  # low
        (4.0, 0.5, 6.0, 2.5, 1, 0.95, 0.2),  # high
        (4.0, 4.0, 4.75, 4.75, 1, 0.95, 0.2),  # small: a step lower
        (8.0, 4.0, 10.0, 7.0, 2, 0.95, 0.1),  # lies above the trend although it is subsidence: a step lower
    ]
    zones = outlined(screening(*patches)).frame
    found = [(z["confidence"], round(z["probability"], 2), z["plan_m2"]) for _, z in zones.iterrows()]
    assert found == [
        ("high", 0.95, 4.0),
        ("medium", 0.95, 6.0),
        ("medium", 0.8, 4.0),
        ("medium", 0.95, 0.5625),
        ("low", 0.55, 4.0),
    ]
    # Where a third of the ground stands out, nothing is certain.
    everywhere = outlined(screening(*patches, (0.0, 7.5, 12.0, 10.0, 1, 0.95, 0.2))).frame
    assert set(everywhere["confidence"]) == {"low"}
    unlearnt = outlined(screening(*patches, name="residual")).frame
    assert "high" not in set(unlearnt["confidence"])
    assert set(unlearnt["method"]) == {"residual"}


def test_small_and_improbable_ones_are_left_out():
    found = screening((1, 1, 1.5, 1.5, 1, 0.9, 0.2), (4, 4, 6, 6, 1, 0.7, 0.2))
    assert len(outlined(found, minimum_hazard_area=0.1).frame) == 2
    assert len(outlined(found, minimum_hazard_area=0.5).frame) == 1
    found.decision = Decision(0.8)
    hazards = outlined(found, minimum_hazard_area=0.1)
    assert len(hazards.frame) == 1
    assert hazards.labels.sum() == 4


@pytest.mark.parametrize(("voxel", "cell"), [(0.4, 0.25), (0.4, 0.1), (0.3, 0.25), (0.12, 0.25)])
def test_voxels_wider_than_cells_leave_no_holes(voxel, cell):
    rng = np.random.default_rng(4)
    west, south = (a.ravel() for a in np.meshgrid(np.arange(0, 12, voxel), np.arange(0, 10, voxel)))
    x, y = west + voxel * rng.uniform(0.2, 0.8, west.size), south + voxel * rng.uniform(0.2, 0.8, west.size)
    # nothing is known in a strip two metres wide
    x, y = x[(x < 9) | (x > 11)], y[(x < 9) | (x > 11)]
    raised = np.hypot(x - 5, y - 5) < 3
    found = screening()
    found.points, found.count = np.column_stack([x, y, TAN * y]), np.full(len(x), 3)
    found.detectable.heights = np.empty((0, len(x)))
    found.probabilities = np.where(raised[:, None], [0.1, 0.9, 0.0], [0.9, 0.1, 0.0]).astype(np.float32)
    found.labels = raised.astype(np.uint8)
    found.heights, found.bridged = np.where(raised, 0.2, 0.0).astype(np.float32), voxel
    hazards = outlined(found, probability_cell=cell)
    zone = hazards.frame.iloc[0]
    assert len(hazards.frame) == 1
    assert zone["plan_m2"] == pytest.approx(np.pi * 9, rel=0.06)
    assert zone["probability"] == pytest.approx(0.9, abs=0.02)
    assert zone["points"] == pytest.approx(3 * raised.sum(), rel=0.05)
    assert len(zone.geometry.geoms[0].interiors) == 0
    known = np.isfinite(hazards.heights)
    middle = hazards.grid.west + (np.arange(hazards.grid.columns) + 0.5) * cell
    assert not known[:, (middle > 9.3) & (middle < 10.7)].any()
    edge = round(1 / cell)
    assert known[edge:-edge, (middle > 1) & (middle < 8)].all()
    np.testing.assert_array_equal(known, np.isfinite(hazards.probability[1]))


def test_neighbours_of_another_class_are_zones_of_their_own():
    zones = outlined(screening((2, 2, 4, 4, 1, 0.9, 0.2), (4, 2, 6, 4, 2, 0.9, -0.2))).frame
    assert sorted(zones["kind"]) == ["subsidence", "uplift"]


def test_a_narrow_gap_without_points_does_not_divide_a_zone_but_ground_does():
    patch = (2, 2, 8, 4, 1, 0.9, 0.2)
    gap = outlined(screening(patch, skip=lambda x, _: (x > 4.0) & (x < 4.5)))
    assert len(gap.frame) == 1
    assert gap.frame["plan_m2"].iloc[0] == pytest.approx(11.0)
    wide = outlined(screening(patch, skip=lambda x, _: (x > 4.0) & (x < 5.0)))
    assert len(wide.frame) == 2
    ground = outlined(screening(patch, (4.0, 0, 4.5, 10, 0, 0.9, 0.0)))
    assert len(ground.frame) == 2


def test_rasters_hold_the_mean_of_a_cells_points_and_nothing_elsewhere():
    hazards = outlined(screening((2, 2, 4, 4, 1, 0.8, 0.3), skip=lambda x, y: (x < 1) & (y < 1)), probability_cell=0.5)
    assert hazards.grid.shape == (20, 24)
    north_up = hazards.probability[:, ::-1]
    np.testing.assert_allclose(north_up[:, 5, 5], [0.1, 0.8, 0.1], atol=1e-6)
    assert np.isnan(north_up[:, :2, :2]).all()
    assert np.isfinite(hazards.probability).sum() == 3 * (20 * 24 - 4)
    assert hazards.labels[::-1][5, 5] == 1
    assert hazards.labels.sum() == 16
    assert hazards.heights[::-1][5, 5] == pytest.approx(0.3)


def test_the_smallest_hazard_of_a_cell_is_the_mean_of_its_voxels():
    found = screening()
    heights = np.stack([found.points[:, 0], np.where(found.points[:, 1] < 1, np.nan, 2.0)])
    found.detectable = SimpleNamespace(diameters=(2.0, 3.0), heights=heights)
    hazards = outlined(found, probability_cell=0.5)
    assert list(hazards.smallest) == [2.0, 3.0]
    np.testing.assert_allclose(hazards.smallest[2.0][3, :4], [0.25, 0.75, 1.25, 1.75], atol=1e-6)
    north_up = hazards.smallest[3.0][::-1]
    assert np.isnan(north_up[:2]).all()
    assert (north_up[2:] == 2.0).all()


def test_a_slope_on_which_nothing_can_be_found_has_no_zones():
    patch = (2, 2, 4, 4, 1, 0.99, 0.2)
    assert len(outlined(screening(patch)).frame) == 1
    hidden = outlined(screening(patch, least=np.inf))
    assert len(hidden.frame) == 0
    assert not hidden.labels.any()
    assert np.nanmax(hidden.probability[1]) == pytest.approx(0.99)


def test_without_hazards_there_are_no_zones():
    hazards = outlined(screening())
    assert len(hazards.frame) == 0
    assert list(hazards.frame.columns) == [*FIELDS, "geometry"]


def test_points_on_and_next_to_the_cells_edges_are_in_the_grid():
    found = screening((2, 2, 4, 4, 1, 0.8, 0.3))
    for edge in (12.0, 12.0 - 1e-8, 12.0 + 1e-8):
        found.points[-1, :2] = edge
        assert outlined(found).grid.shape[1] >= 48


def test_a_raster_beyond_all_measure_is_refused():
    found = screening()
    found.points[0] = (1e6, 1e6, 0)
    with pytest.raises(InputError, match=r"probability_cell above 0\.25 m"):
        outlined(found)


def test_zones_of_the_slopes_raster_are_the_maps_zones_whatever_their_probability():
    found = screening((2, 2, 4, 4, 0, 0.8, 0.2), (6, 2, 8, 4, 1, 0.9, 0.2))
    x, y = found.points[:, :2].T
    zones = np.where((x > 2) & (x < 4.0) & (y > 2) & (y < 4), 2, 0).astype(np.uint8)
    found.decision = Decision(0.0, zones)
    found.labels = found.decision.of_voxels(found.probabilities)
    hazards = outlined(found)
    assert hazards.frame["kind"].tolist() == ["subsidence"]
    assert hazards.frame["plan_m2"].iloc[0] == pytest.approx(4.0)
    assert hazards.frame["probability"].iloc[0] == pytest.approx(0.1, abs=1e-6)
    assert hazards.frame["confidence"].iloc[0] == "low"
    found.decision = Decision(np.inf, zones)
    assert len(outlined(found).frame) == 0


def test_a_cell_is_of_the_class_of_most_of_its_points_by_zones():
    decision = Decision(0.0, np.array([1, 2, 2, 0, 0], dtype=np.uint8))
    index, count = np.array([0, 0, 0, 2, 2]), np.array([5, 2, 2, 1, 9])
    probabilities = np.array([[0.9, 0.1, 0.0], [np.nan] * 3, [0.1, 0.9, 0.0]])
    assert decision.of_cells(index, count, probabilities).tolist() == [1, 0, 0]
    assert Decision(0.0).of_cells(index, count, probabilities).tolist() == [0, 0, 1]
    assert decision.of_points(np.array([2, 0, 3]), np.zeros((3, 3))).tolist() == [2, 1, 0]


def test_the_least_probability_counts_for_hazards_only():
    probabilities = np.array([[0.4, 0.3, 0.3], [0.2, 0.5, 0.3], [0.1, 0.0, 0.9]])
    assert Decision(0.0).of_voxels(probabilities).tolist() == [0, 1, 2]
    assert Decision(0.6).of_voxels(probabilities).tolist() == [0, 0, 2]
    assert not Decision(np.inf).of_voxels(probabilities).any()
    assert Decision(np.inf).hidden


def test_an_improbable_zone_is_left_out_as_a_whole_and_the_larger_score_has_the_cell():
    up, down, probability = np.zeros((8, 20)), np.zeros((8, 20)), np.zeros((3, 8, 20))
    up[2:6, 2:6] = up[2:6, 12:16] = 5.0
    down[4:8, 2:6] = 4.0
    down[4, 2:6] = 6.0
    up[0, 8:11] = 9.0  # too small for a zone
    probability[1, 2, 2], probability[1, 2:6, 12:16], probability[2, 7, 5] = 0.3, 0.2, 0.4
    scores = Scores(up, down, 0.5)
    found = zone_labels(scores, 3.0, probability, 0.0)
    expected = np.zeros((8, 20))
    expected[2:6, 2:6] = expected[2:6, 12:16] = 1
    expected[4, 2:6] = expected[6:8, 2:6] = 2
    np.testing.assert_array_equal(found, expected)
    expected[2:6, 12:16] = 0
    np.testing.assert_array_equal(zone_labels(scores, 3.0, probability, 0.3), expected)
    assert not zone_labels(scores, 3.0, probability, np.inf).any()
