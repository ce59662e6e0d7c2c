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
from slopewatch.engine.series.zone_series import Stack, zone_series

SHAPE, CELL, DAYS = (40, 80), 0.5, 30.0 * np.arange(5)
GRID = Grid(0.0, 20.0, CELL, *SHAPE)
SIGMA = 0.01
LAWS = {
    "fast": -0.006 * DAYS,
    "half as fast": -0.003 * DAYS,
    "later": -0.012 * np.maximum(DAYS - 60, 0),
    "raised": 0.006 * DAYS,
}


def judged(second: str, gap_cells: int):
    """Zones of 5 by 5 m side by side."""
    rng = np.random.default_rng(0)
    shapes = [np.zeros(SHAPE, dtype=bool) for _ in range(2)]
    shapes[0][10:20, 10:20] = True
    shapes[1][10:20, 20 + gap_cells : 30 + gap_cells] = True
    laws = (LAWS["fast"], LAWS[second])
    moved = [sum(law[i] * shape for law, shape in zip(laws, shapes, strict=True)) for i in range(5)]
    change = [np.zeros(SHAPE), *(rng.normal(0, SIGMA, SHAPE) + m for m in moved[1:])]
    significant = [np.abs(c) > 1.96 * SIGMA for c in change]
    stack = Stack(DAYS, change, [np.full(SHAPE, SIGMA**2 / 2)] * 5, [0.0, *[0.003] * 4], significant, CELL)
    tracks = []
    for number, (shape, law) in enumerate(zip(shapes, laws, strict=True), 1):
        cells = np.flatnonzero(shape)
        tracks.append(Track(f"S00{number}", int(np.sign(law[-1])), (Sighting(1, cells, "new"),), cells, "", ""))
    alerts = read_alerts(None)
    zones = zone_series(tracks, stack, alerts, minimum_area=1.0, bridged=2)
    return with_bodies(judged_zones(zones, DAYS, (), CELL, alerts), GRID)


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
