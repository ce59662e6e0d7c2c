"""The table of motion along the surface says what its cases hold."""

from __future__ import annotations

import numpy as np
import pytest
from slopewatch.lab.benchmarks.displacement_rows import Windows, beside_rows, moving_rows, still_rows, window_rows


def still(error: list[list[float]], stated: float, usable: float = 0.5, zones: int = 0) -> dict:
    found = np.array(error)
    windows = Windows(found, np.full(found.shape, stated), ((found / stated) ** 2).sum(axis=1), usable).as_lists()
    return {
        "windows": {"reported": windows, "5": windows, "8": windows},
        "zones": zones,
        "reported": [1, 0, 50],
        "seconds": 2.0,
    }


def test_errors_and_their_honesty_are_of_all_windows_of_all_maps():
    maps = [still([[0.03, 0.0], [0.0, 0.04]], 0.011), still([[0.0, 0.0], [0.0, 0.0]], 0.011, usable=1.0)]
    rms, within, false = window_rows("x", 5.0, maps, (20.0, 19.0))
    assert rms.value == "15.0 / 20.0 mm"
    assert rms.met is False
    assert "(4)" in rms.figure
    assert rms.peer.startswith("75 %")
    assert within.value == "75.0 / 75.0 %"
    assert false.value == "25.00 %"  # 0.04 / 0.011 is beyond 3.03 standard errors, 0.03 / 0.011 is not


def test_no_vector_at_all_is_a_row_of_its_own():
    empty = {"windows": {"5": {"error": [], "stated": [], "statistic": [], "usable": 0.0}}}
    (row,) = window_rows("x", 5.0, [empty], None)
    assert row.value == "no vector"


def test_false_zones_are_counted_on_maps_with_and_without_plants():
    pairs = [{"still": still([[0.0, 0.0]], 0.01, zones=z)} for z in (0, 2)]
    rows = still_rows(pairs, [0, 2, 1, 0, 0], {5.0: (20.0, 27.0)})
    (zones,) = [row for row in rows if row.figure == "still maps with a zone"]
    (reported,) = [row for row in rows if "as they are reported" in row.figure]
    assert (reported.value, reported.peer, reported.met) == ("2.00 % of 100", "0 are drawn", False)
    assert (zones.value, zones.peer, zones.met) == ("2 of 5", "1 of 2 under plants, 1 of 3 bare", False)


@pytest.mark.parametrize(("core", "wrong"), [([0.02, 0.09], 0), ([0.02, 0.11], 1)])
def test_vectors_that_are_wrong_in_the_core_are_counted(core, wrong):
    moved = {"zones": 1, "bias": 0.03, "core": core, "shown": {"5": [True, False], "8": [True, True]}}
    pairs = [{"moved": {"0.1": moved}}, {"moved": {"0.1": moved | {"zones": 0, "bias": None, "core": []}}}]
    rows = {row.figure: row for row in moving_rows(pairs)}
    assert rows["vectors in a zone's core wrong by more than 0.1 m"].value == f"{wrong} of 2"
    assert rows["10 cm: zone found"].value == "1 of 2"
    assert rows["10 cm: bias of the zones' motion along the dip"].value == "+3.0 %"
    assert rows["10 cm down the dip: windows of 5 m that show it"].value == "50 % of 4"
    assert rows["10 cm down the dip: windows of 8 m that show it"].met is True


def test_all_methods_are_compared_in_the_same_windows_with_the_best_width_of_icp():
    nothing = [float("nan"), float("nan")]
    cases = [
        {"displacement": [[0.01, 0.0]], "patch-wise ICP, 5 m": [[0.03, 0.0]], "patch-wise ICP, 8 m": [[0.015, 0.0]],
         "plain correlation, 5 m": [nothing]},
        {"displacement": [[0.0, 0.01]], "patch-wise ICP, 5 m": [[0.0, 0.03]], "patch-wise ICP, 8 m": [[0.0, 0.015]],
         "plain correlation, 5 m": [[0.12, 0.0]]},
    ]  # fmt: skip
    ours, narrow, wide, correlation = beside_rows("x", cases)
    assert (ours.value, ours.met) == ("7.1 mm", True)
    assert ours.peer.startswith("0.67 x")
    assert narrow.peer.startswith("2.00 x")
    assert wide.peer.startswith("1.00 x")
    assert correlation.value == "84.9 mm"
    assert "100.0 % wrong" in correlation.peer
    (worse,) = [row for row in beside_rows("x", [cases[1] | {"displacement": [[0.013, 0.0]]}]) if row.met is not None]
    assert worse.met is False
