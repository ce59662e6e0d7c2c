"""Zones of heights and ground that moves, joined: what is one place is one zone."""

from __future__ import annotations

from dataclasses import replace
from datetime import date, timedelta

import numpy as np
import pytest
from pyproj import CRS
from slopewatch.engine.displacement.facets import Facets
from slopewatch.engine.displacement.frame import Frame
from slopewatch.engine.grid.grid import Grid
from slopewatch.engine.series.alerts import read_alerts
from slopewatch.engine.series.joined import cells_of, joined_zones
from slopewatch.engine.series.judged import judged_zones
from slopewatch.engine.series.motion.windows import Layout
from slopewatch.engine.series.motion.zones import MovingGround
from slopewatch.engine.series.tables import About, zone_frame
from slopewatch.engine.series.tracking import Sighting, Track
from slopewatch.engine.series.zone_means import ZoneMeans
from slopewatch.engine.series.zone_series import zone_series

SHAPE, DAYS, CELL = (40, 60), np.array([0.0, 30.0, 60.0, 90.0]), 0.5
GRID = Grid(100.0, 220.0, CELL, *SHAPE)  # 30 by 20 m
WINDOWS = Grid(100.0, 220.0, 2.0, 10, 15)
LAYOUT = Layout(
    WINDOWS,
    np.arange(150),
    Facets((Frame(np.eye(3), np.zeros(3)),), np.zeros((1, 1), dtype=np.int64), *[np.zeros((1, 1))] * 4),
    np.zeros(150, dtype=np.int64),
    np.zeros((150, 3)),
)
ALERTS = read_alerts(None)


def heights(cells: np.ndarray, rate: float) -> ZoneMeans:
    """Cells whose heights sink by ``rate`` metres a day."""
    area, sigma = len(cells) * CELL**2, 0.001
    change = rate * DAYS + np.array([0.0, 0.001, -0.001, 0.0005])
    lowered = np.array([0.0, area, area, area])
    error = np.array([0.0, *[2**0.5 * sigma * area] * 3])
    return ZoneMeans(cells, area, change, np.full(4, sigma**2), change * area, error, np.ones(4), lowered, np.zeros(4))


def sinking(rate: float):
    """A zone of 5 by 5 m."""
    inside = np.zeros(SHAPE, dtype=bool)
    inside[10:20, 10:20] = True
    cells = np.flatnonzero(inside)
    track = Track("S001", -1, (Sighting(1, cells, "new"),), cells, "", "")
    return zone_series(track, heights(cells, rate), DAYS, ALERTS, minimum_area=1.0)


def ground(row: int, column: int, rate: float, number: int = 1, error: float = 0.005) -> MovingGround:
    """Ground of 6 by 6 m whose upper left window is given, which moves east by ``rate`` metres a day."""
    windows = np.array([(row + r) * WINDOWS.columns + column + c for r in range(3) for c in range(3)])
    covariance = np.zeros((4, 3, 4, 3))
    for i in range(1, 4):
        for j in range(1, 4):
            covariance[i, :, j] = np.eye(3) * error**2 * (1.0 if i == j else 0.5)
    motion = np.zeros((4, 3))
    motion[:, 0] = rate * DAYS
    return MovingGround(
        f"M{number:03d}", windows, 36.0, 25.0, np.zeros(3), np.eye(3), motion, covariance, motion[1] / 30,
        np.eye(3) * (error / 90) ** 2, 0.0, 0.001, 2, np.array([1.0, 0.0, 0.0]), (Sighting(2, windows, "new"),), "",
    )  # fmt: skip


def joined(rate: float, *moving: MovingGround):
    zones = (sinking(rate),)
    placed = [(one, heights(cells_of(one.windows, LAYOUT, GRID), 0.0)) for one in moving]
    found = joined_zones(zones, placed, LAYOUT, GRID, DAYS, ALERTS)
    return zones, judged_zones(found, DAYS, (), ALERTS)


def test_the_cells_of_windows_are_those_whose_middles_they_hold():
    cells = cells_of(np.array([0, 16]), LAYOUT, GRID)
    row, column = np.divmod(cells, GRID.columns)
    assert set(zip((row // 4).tolist(), (column // 4).tolist(), strict=True)) == {(0, 0), (1, 1)}
    assert len(cells) == 32


def test_one_place_is_one_zone_whatever_found_it():
    zones, (zone,) = joined(-0.001, ground(2, 2, 0.004))
    assert (zone.track.zone_id, zone.kind, zone.found_by) == ("S001", "subsidence", "both")
    assert np.array_equal(zone.change, zones[0].change, equal_nan=True)
    assert zone.motion.ground.zone_id == "M001"
    assert zone.cells is zones[0].cells  # what the polygon, the area and the volume are of


def test_ground_whose_heights_show_nothing_is_a_zone_of_its_own():
    zones, found = joined(-0.001, ground(6, 10, 0.004))
    assert found[0].track is zones[0].track
    other = found[1]
    assert (other.track.zone_id, other.kind, other.found_by) == ("M001", "sliding", "motion")
    assert other.alert.level >= 2
    assert other.alert_reason == "along the surface: rate 122 mm/month, beyond 30.4 with an error chance of 0.1 %"
    assert other.epochs_confirmed == 3
    assert abs(other.change[-1]) < 0.01  # its heights
    assert other.motion.course.velocity.rate == pytest.approx(0.004, rel=0.02)


def test_what_slid_lost_and_gained_no_material():
    _, found = joined(-0.001, ground(6, 10, 0.004))
    days = tuple(date(2024, 5, 1) + timedelta(days=float(day)) for day in DAYS)
    about = About(days, CRS.from_epsg(32651), GRID, "", "")
    frame = zone_frame(found, np.full(SHAPE, -0.09), np.zeros(SHAPE), about).set_index("zone_id")
    assert frame.loc["M001", "kind"] == "sliding"
    assert frame.loc["M001", ["vol_loss_m3", "vol_gain_m3"]].isna().all()
    assert np.isfinite(frame.loc["M001", "vol_net_m3"])
    assert frame.loc["S001", "vol_loss_m3"] > 0


def test_of_two_places_in_one_zone_the_larger_part_counts():
    _, found = joined(-0.001, ground(4, 3, 0.004, 1), ground(2, 2, 0.003, 2))
    assert [(z.track.zone_id, z.found_by) for z in found] == [("S001", "both"), ("M001", "motion")]
    assert found[0].motion.ground.zone_id == "M002"


def test_the_higher_alert_counts_and_says_by_what():
    _, (zone,) = joined(-0.006, ground(2, 2, 0.0005))
    assert not zone.motion.leads
    assert zone.alert_reason.startswith("rate 183 mm/month")
    assert zone.leading.velocity is zone.velocity
    _, (faster,) = joined(-0.0005, ground(2, 2, 0.006))
    assert faster.motion.leads
    assert faster.alert.level == 3
    assert faster.alert_reason.startswith("along the surface: rate")
    assert faster.leading is faster.motion.course


def test_motion_along_the_surface_has_a_tangent_angle():
    faster = ground(6, 10, 0.001, error=0.008)
    motion = faster.motion.copy()
    motion[:, 0] = [0.0, 0.03, 0.06, 0.11]
    _, found = joined(-0.001, replace(faster, motion=motion))
    assert found[1].motion.course.angle.degrees == pytest.approx(np.degrees(np.arctan(5 / 3)), abs=0.1)


def test_a_zone_that_motion_showed_first_keeps_its_name():
    _, (zone,) = joined(-0.001, replace(ground(2, 2, 0.004), found=0))
    assert (zone.track.zone_id, zone.kind, zone.found_by) == ("M001", "subsidence", "both")


def test_motion_that_is_significantly_uphill_is_a_doubt_and_no_alert():
    steep = np.array([[0.8, 0.0, -0.6], [0.0, 1.0, 0.0], [0.6, 0.0, 0.8]])
    down = replace(ground(6, 10, 0.006), axes=steep)
    motion = np.outer(0.006 * DAYS, steep[0])
    down = replace(down, motion=motion, direction=steep[0])
    _, found = joined(-0.0005, down)
    assert found[1].alert.level == 3
    up = replace(down, motion=-motion, direction=-steep[0])
    _, found = joined(-0.0005, up)
    assert (found[1].alert.level, found[1].history.levels) == (0, (0, 0, 0, 0))
    assert found[1].alert_reason == "doubtful: the motion is uphill, 180 degrees off the dip"
    flat = replace(up, axes=np.eye(3), motion=np.outer(0.006 * DAYS, [-1.0, 0, 0]), direction=np.array([-1.0, 0, 0]))
    _, found = joined(-0.0005, flat)
    assert found[1].alert.level == 3  # on level ground no way is uphill
