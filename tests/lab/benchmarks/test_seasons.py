"""What the benchmark of seasons measures, on known misplacements and a small pair."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from slopewatch.lab.benchmarks import seasons
from slopewatch.lab.benchmarks.seasons import MOWN, PAIRS, PLACES, misplaced, place_of, rows, simulated


@pytest.fixture(scope="module")
def pair():
    found = pytest.MonkeyPatch()
    found.setattr(seasons, "POINTS", 12_000)
    made = simulated(0)
    found.undo()
    return made


def test_every_place_is_mown_in_either_survey():
    known = {(place_of(n), MOWN[n % len(MOWN)]) for n in range(PAIRS)}
    assert known == {(place, mown) for place in PLACES for mown in MOWN}


def test_misplacement_is_told_apart_into_height_and_slide(pair):
    surveyed = pair.second.xyz
    right = pair.transform.apply(surveyed)
    assert misplaced(pair, right, surveyed) == pytest.approx((0.0, 0.0), abs=1e-9)
    height, slide = misplaced(pair, right + [0.0, 0.0, 0.02], surveyed)
    assert height == pytest.approx(0.02, rel=1e-6), "of the surface at a place"
    assert slide == pytest.approx(0.02 * np.sin(np.radians(30.0)), rel=0.15)


def test_rows_name_where_zones_are_false(monkeypatch):
    quiet = seasons.Unmoved("grass all over", 0, 0.0, 0.05, 0.01, 0.002, 0.01, 0.004, 0.08, False)
    loud = replace(quiet, place="patches of grass", zones=2, zone_area=1.5, height_error=-0.03)
    monkeypatch.setattr(seasons, "results", lambda: ([quiet, loud], {"published settings": loud}))
    made = rows()
    assert made[0].value == "2 (patches of grass 2; 1.5 m² together)"
    assert [row.met for row in made] == [False, True, None, False, True]
    assert "worst -30.0" in made[3].value
    monkeypatch.setattr(seasons, "results", lambda: ([quiet], {}))
    assert rows()[0].met is True
