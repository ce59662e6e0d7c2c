"""Series of the benchmark are kept one by one, and a run goes on where it was stopped."""

from __future__ import annotations

import numpy as np
import pytest
from slopewatch.benchmarks import series_motion
from slopewatch.benchmarks.series_motion_store import Outcome, append, read

MOVING, STILL = ("simulated", 3, (1.0, 0.6)), ("real", 6, ())


def outcome() -> Outcome:
    off, stated = np.array([0.02, -0.01, 0.003]), np.array([0.015, 0.01, 0.001])
    return Outcome([off], [stated], [0.98], [0.04], alerts=[(1.0, 3, None), (0.6, None, None)])


def test_what_was_kept_is_read_again(tmp_path):
    store = tmp_path / "kept" / "series_motion.jsonl"
    append(store, MOVING, outcome())
    append(store, STILL, Outcome(still_series=1, still_with_zone=1))
    with store.open("a") as file:
        file.write('{"kind": "simulated", "seed": 4, "ra')  # a kill
    append(store, ("simulated", 5, ()), Outcome(still_series=1))
    kept = read(store)
    assert list(kept) == [MOVING, STILL, ("simulated", 5, ())]
    assert np.array_equal(kept[MOVING].off[0], outcome().off[0])
    assert kept[MOVING].alerts == outcome().alerts
    assert (kept[STILL].still_series, kept[STILL].still_with_zone) == (1, 1)


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
    # two zones with two components of three within two standard errors each; one of the two vectors' axes is 3 off
    shares = [row for row in rows if "within two standard errors" in row.figure]
    assert shares[0].figure.startswith("simulated")
    assert "2 zones" in shares[0].figure
    assert shares[0].value == "67 %"
    assert shares[0].peer.startswith("0 % of the vectors")
