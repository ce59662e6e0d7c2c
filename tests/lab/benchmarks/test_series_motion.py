"""Series of the benchmark are kept one by one, and their ground moves as they say."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from slopewatch.engine.displacement.facets import find_facets
from slopewatch.lab.benchmarks import series_motion
from slopewatch.lab.benchmarks.series_motion import Outcome
from slopewatch.lab.benchmarks.series_motion_cases import Sliding, _places
from slopewatch.tests.builders.rough_ground import axes, relief, sampled

MOVING, STILL = ("simulated", 3, (1.0, 0.6)), ("real", 6, ())


def outcome() -> Outcome:
    off, stated = [0.02, -0.01, 0.003], [0.015, 0.01, 0.001]
    return Outcome([off], [stated], [0.98], [0.04], alerts=[(1.0, 3, None), (0.6, None, None)])


def test_a_run_goes_on_where_it_was_stopped(tmp_path, monkeypatch):
    measured = []

    def fails_at_the_third(key):
        measured.append(key)
        if len(measured) == 3:
            raise KeyboardInterrupt
        return Outcome(still_series=1) if not key[2] else outcome()

    monkeypatch.setattr(series_motion, "measured", fails_at_the_third)
    monkeypatch.setattr(series_motion, "keys", lambda: [MOVING, STILL, ("simulated", 4, (0.4,))])
    with pytest.raises(KeyboardInterrupt):
        series_motion.rows(tmp_path / "series_motion.csv")
    rows = series_motion.rows(tmp_path / "series_motion.csv")
    assert measured == [MOVING, STILL, ("simulated", 4, (0.4,)), ("simulated", 4, (0.4,))]
    assert (tmp_path / "series_motion.jsonl").exists()
    # two zones with two components of three within two standard errors each; one of the two vectors' axes is 3 off
    shares = [row for row in rows if "within two standard errors" in row.figure]
    assert shares[0].figure.startswith("simulated")
    assert "2 zones" in shares[0].figure
    assert shares[0].value == "67 %"
    assert shares[0].peer.startswith("0 % of the vectors")
    (alerts,) = (row for row in rows if "1 mm/day" in row.figure)
    assert (alerts.value, alerts.peer) == ("3, 3", "by heights alone: none, none")


def test_a_still_series_follows_the_moving_one_of_its_ground():
    keys = series_motion.keys()
    assert len(set(keys)) == len(keys)
    for moving, still in zip(keys[::2], keys[1::2], strict=True):
        assert moving[:2] == still[:2]
        assert moving[2]
        assert not still[2]


def test_an_ellipse_moves_in_its_direction_within_its_outline():
    ground = sampled(relief(20.0, 0.1, seed=2), 20.0, 0.02, 1)
    frame = find_facets(ground).frames[0]
    one = Sliding(frame, np.array([1.0, -0.5]), 0.002, np.radians(20.0))
    middle = frame.origin + one.middle @ frame.axes[:2]
    way = one.velocity(middle[None])[0]
    assert np.linalg.norm(way) == pytest.approx(0.002)
    assert np.degrees(np.arctan2(way @ frame.axes[1], way @ frame.axes[0])) == pytest.approx(20.0)
    on_plane = ground - ((ground - frame.origin) @ frame.axes[2])[:, None] * frame.axes[2]
    inside = shapely.contains_xy(one.outline, on_plane[:, 0], on_plane[:, 1])
    moves = np.linalg.norm(one.velocity(on_plane), axis=1) > 0
    assert inside.sum() > 500
    assert np.mean(inside == moves) > 0.99
    assert one.outline.area == pytest.approx(np.pi * 4.5 * 3.25 * axes()[2, 2], rel=0.03)


def test_ellipses_lie_on_ground_and_apart():
    rates = (0.5, 0.8)
    wide, small = (sampled(relief(side, 0.1, seed=2), 30.0, 0.02, 1) for side in (40.0, 12.0))
    first, second = _places(wide, find_facets(wide).frames[0], rates, np.random.default_rng(0))
    assert not first.outline.intersects(second.outline)
    assert [first.rate, second.rate] == [0.0005, 0.0008]
    cloud = shapely.MultiPoint(wide[:, :2]).convex_hull
    assert all(cloud.intersection(one.outline).area > 0.9 * one.outline.area for one in (first, second))
    assert len(_places(small, find_facets(small).frames[0], rates, np.random.default_rng(0))) < 2
