"""Zones that adjoin and move alike are one body with one alert."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from slopewatch.engine.grid.grid import Grid
from slopewatch.engine.series.alerts import read_alerts
from slopewatch.engine.series.bodies import with_bodies
from slopewatch.engine.series.judged import judged_zones
from slopewatch.engine.series.tracking import Sighting, Track
from slopewatch.engine.series.zone_means import ZoneMeans
from slopewatch.engine.series.zone_series import zone_series

SHAPE, CELL, DAYS = (40, 80), 0.5, 30.0 * np.arange(5)
GRID = Grid(0.0, 20.0, CELL, *SHAPE)
SIGMA = 0.003
LAWS = {
    "fast": -0.006 * DAYS,
    "half as fast": -0.003 * DAYS,
    "later": -0.012 * np.maximum(DAYS - 60, 0),
    "raised": 0.006 * DAYS,
}


def judged(second: str, gap_cells: int):
    """Zones of 5 by 5 m side by side."""
    rng, alerts, zones = np.random.default_rng(0), read_alerts(None), []
    for number, (law, column) in enumerate(((LAWS["fast"], 10), (LAWS[second], 20 + gap_cells)), 1):
        shape = np.zeros(SHAPE, dtype=bool)
        shape[10:20, column : column + 10] = True
        cells, area = np.flatnonzero(shape), 25.0
        change = law + np.array([0.0, *rng.normal(0, SIGMA, 4)])
        seen = np.array([0.0, *[area] * 4])
        lowered, raised = (seen, 0 * seen) if law[-1] < 0 else (0 * seen, seen)
        variance, error = np.full(5, SIGMA**2 / 2), np.array([0.0, *[SIGMA * area] * 4])
        means = ZoneMeans(cells, area, change, variance, change * area, error, np.ones(5), lowered, raised)
        track = Track(f"S00{number}", int(np.sign(law[-1])), (Sighting(1, cells, "new"),), cells, "", "")
        zones.append(zone_series(track, means, DAYS, alerts, minimum_area=1.0))
    return with_bodies(judged_zones(zones, DAYS, (), alerts), GRID)


def test_a_part_of_a_slide_has_the_level_of_the_slide():
    one, other = judged("half as fast", 3)
    assert (one.body, other.body) == ("S001", "S001")
    assert one.alert.level == other.alert.level == 3
    assert other.alert_reason == f"one body with S001: {one.alert_reason}"


@pytest.mark.parametrize(("second", "gap"), [("half as fast", 12), ("later", 3), ("raised", 3)])
def test_zones_apart_and_zones_that_move_otherwise_are_bodies_of_their_own(second, gap):
    one, other = judged(second, gap)
    assert (one.body, other.body) == ("S001", "S002")
    assert "one body" not in other.alert_reason


def test_the_name_does_not_depend_on_the_order():
    zones = judged("half as fast", 3)
    again = with_bodies([replace(z, body="") for z in reversed(zones)], GRID)
    assert {z.body for z in again} == {"S001"}
