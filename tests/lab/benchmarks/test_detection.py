"""What counts as found, as false and as covered, on changes and zones made by hand."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from slopewatch.engine.change.difference import difference
from slopewatch.engine.grid.grid import Grid
from slopewatch.engine.zones.change_zones import change_zones
from slopewatch.interface.parameters import ChangeParameters
from slopewatch.lab.benchmarks import detection
from slopewatch.lab.benchmarks.detection import AMPLITUDE, AREA, LENGTH, compared, drawn_changes
from slopewatch.lab.benchmarks.detection_curves import false_alarms, recall
from slopewatch.lab.benchmarks.detection_results import (
    Detected,
    FalseZone,
    PairResult,
    Volume,
    read_results,
    write_results,
)
from slopewatch.simulation.frame import Frame
from slopewatch.simulation.surveys.change import Bump, true_change_raster

FRAME = Frame()
KNOWN = (Bump(5.0, 5.0, 2.0, 2.0, 0.3), Bump(15.0, 5.0, 2.0, 2.0, -0.3))


@pytest.fixture(scope="module")
def flat():
    """The change between two noisy clouds of flat ground, in which the first of KNOWN was put, not the second; in
    addition, a patch rose that is in no list.
    """
    rng = np.random.default_rng(3)
    clouds = []
    for epoch in range(2):
        local = np.column_stack([rng.uniform(0, 20, 60_000), rng.uniform(0, 10, 60_000), np.zeros(60_000)])
        if epoch:
            local[:, 2] += KNOWN[0].dz(local[:, 0], local[:, 1])
            local[(np.abs(local[:, 0] - 10) < 0.8) & (np.abs(local[:, 1] - 8) < 0.8), 2] += 0.2
        local[:, 2] += rng.normal(0, 0.01, len(local))
        clouds.append(FRAME.to_world(local))
    change = difference(*clouds, ChangeParameters(cell=0.2))
    return change, change_zones(change)


def _pair(changes):
    def raster(grid: Grid, subsamples: int) -> np.ndarray:
        return true_change_raster(changes, FRAME, grid, subsamples)

    return SimpleNamespace(
        changes=changes,
        scene=SimpleNamespace(frame=FRAME),
        parameters=SimpleNamespace(vegetation=0.0),
        true_change_raster=raster,
    )


def test_what_is_there_is_found_what_is_not_is_false(flat):
    found = compared(_pair(KNOWN), *flat)
    there, missing = found.changes
    assert there.share > 0.9
    assert missing.share == 0.0
    assert there.ratio > 5
    (false,) = found.false_zones
    assert false.amplitude == pytest.approx(0.2, abs=0.02), "the patch that no list names"
    assert false.area == pytest.approx(1.6**2, rel=0.3)
    assert 0 < false.level < false.amplitude
    assert found.zones == 2
    assert len(found.volumes) == 1
    assert found.volumes[0].true == pytest.approx(np.pi / 3 * 4 * 0.3)
    assert found.volumes[0].covered
    assert not replace(found.volumes[0], true=2 * found.volumes[0].high).covered


def test_a_zone_of_the_other_sign_finds_nothing(flat):
    sunk = (replace(KNOWN[0], height=-0.3),)
    assert compared(_pair(sunk), *flat).changes[0].share == 0.0


def test_drawn_changes_lie_apart_on_the_slope_within_their_ranges():
    for seed in range(20):
        drawn = drawn_changes(np.random.default_rng(seed), 14.8)
        assert 1 <= len(drawn) <= 3
        for number, one in enumerate(drawn):
            assert AMPLITUDE[0] <= abs(one.height) <= AMPLITUDE[1]
            assert AREA[0] * 0.999 <= np.pi * one.half_u * one.half_v <= AREA[1] * 1.001
            west, south, east, north = one.bounds
            assert min(west, south) >= 0
            assert east <= LENGTH
            assert north <= 14.8
            for other in drawn[:number]:
                assert (
                    abs(one.u - other.u) > one.half_u + other.half_u or abs(one.v - other.v) > one.half_v + other.half_v
                )


def test_results_kept_in_a_file_come_back(tmp_path):
    """All but the figures' last digits; a change on which nothing was measured has an infinite level."""
    changed = PairResult(
        changes=(Detected(-0.12, 3.5, 0.04, 0.75, 0.4), Detected(0.05, 1.25, math.inf, 0.0, 0.4)),
        volumes=(Volume(-0.5, -0.25, -0.375),),
        false_zones=(FalseZone(0.06, 0.09, 0.03),),
        zones=2,
        beyond=0.0625,
        vegetation=0.4,
    )
    unchanged = PairResult((), (), (), 0, 0.05, 0.0)
    kept = {"fixed": [changed, unchanged], "growing": [unchanged, unchanged]}
    write_results(tmp_path / "results" / "detection.csv", kept)
    assert read_results(tmp_path / "results" / "detection.csv") == kept
    assert changed.changed
    assert not unchanged.changed


def test_recall_by_class_has_the_interval_of_the_binomial_law():
    """Clopper and Pearson: at an end of the interval, as many found or more (fewer) have a chance of 2.5 %."""
    sizes = ((0.05, 1.0), (0.06, 0.6), (0.07, 0.4), (0.09, 0.9), (0.02, 0.1), (0.04, 0.0))
    changes = tuple(Detected(-height, 1.0, 0.04, share, 0.0) for height, share in sizes)
    unmeasured = Detected(0.3, 1.0, math.inf, 0.0, 0.0)
    pair = PairResult((*changes, unmeasured), (), (), 0, 0.05, 0.0)
    below, beyond = recall([pair], lambda c: c.ratio, (0.0, 1.0, 5.0, 9.0))
    assert (below.found, below.count, below.size) == (0, 1, pytest.approx(0.5))
    assert (beyond.found, beyond.count, beyond.size) == (3, 5, pytest.approx(1.5))
    assert below.low == 0.0
    assert (1 - below.high) ** 1 == pytest.approx(0.025, rel=1e-6)

    def chance(k, p):
        return math.comb(5, k) * p**k * (1 - p) ** (5 - k)

    assert sum(chance(k, beyond.low) for k in range(3, 6)) == pytest.approx(0.025, rel=1e-6)
    assert sum(chance(k, beyond.high) for k in range(4)) == pytest.approx(0.025, rel=1e-6)
    assert [c.count for c in recall([pair], lambda c: abs(c.amplitude), (0.1, 0.5))] == [1]


def test_false_zones_a_slope_have_the_interval_of_poissons_law():
    zones = tuple(FalseZone(change, 1.0, 0.05) for change in (-0.06, 0.09, 0.2))
    pairs = [PairResult((), (), zones[:2], 2, 0.05, 0.0), PairResult((), (), zones[2:], 1, 0.05, 0.0)]
    found = false_alarms([*pairs, *[PairResult((), (), (), 0, 0.05, 0.0)] * 8], (1.0, 1.5, 3.0, 5.0))
    assert found.a_slope.tolist() == [0.3, 0.2, 0.1, 0.0]
    assert found.low[3] == 0.0

    def chance(k, mean):
        return math.exp(-mean) * mean**k / math.factorial(k)

    for count, low, high in zip((3, 2, 1), 10 * found.low, 10 * found.high, strict=False):
        assert 1 - sum(chance(k, low) for k in range(count)) == pytest.approx(0.025, rel=1e-6)
        assert sum(chance(k, high) for k in range(count + 1)) == pytest.approx(0.025, rel=1e-6)
    assert chance(0, 10 * found.high[3]) == pytest.approx(0.025, rel=1e-6)


def test_the_results_that_the_picture_is_drawn_from_are_whole():
    """A run of all pairs with both kinds of cells, half of the pairs without change."""
    kept = read_results(Path(detection.__file__).parent / "results" / "detection.csv")
    assert list(kept) == list(detection.CELLS)
    for pairs in kept.values():
        assert [p.changed for p in pairs] == [True, False] * (detection.PAIRS // 2)
    known = [[(c.amplitude, c.area) for p in pairs for c in p.changes] for pairs in kept.values()]
    assert known[0] == known[1]
