"""Tools take turns on the same files, a missing one is a row, and what was measured is not measured again."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from slopewatch.engine.grid.grid import Grid
from slopewatch.lab.benchmarks import peer_comparison, peers
from slopewatch.lab.benchmarks.peer_case import Case, Judged, Outcome, Tool, Tries, own_tool, script_tool
from slopewatch.lab.benchmarks.peer_difference import judged
from slopewatch.lab.benchmarks.peer_gridding import on
from slopewatch.lab.benchmarks.peer_screening import iou, with_hazards
from slopewatch.lab.benchmarks.peers import PeerMissingError

ADDS = """
import json, sys
import numpy as np
folder = sys.argv[1]
np.save(f"{folder}/found/sum.npy", np.load(f"{folder}/given.npy") + ADDED)
print("a warning before the figures")
print(json.dumps({"cpu": CPU, "seconds": 2 * CPU}))
"""


def adding(added: float, cpu: float) -> str:
    return ADDS.replace("ADDED", str(added)).replace("CPU", str(cpu))


def missing(folder: Path) -> list[str]:
    raise PeerMissingError("any==1.0 cannot be installed: No matching distribution found")


@pytest.fixture
def case() -> Case:
    """Adding 1 to an array, which one tool does right, one wrong, one not at all, and one fails."""

    def prepare(folder: Path) -> float:
        np.save(folder / "given.npy", np.arange(3.0))
        return 1.0

    def judge(truth, found, printed):
        error = float(np.abs(np.load(found / "sum.npy") - np.arange(3.0) - truth).max())
        return Judged(error, f"{error:.1f} off")

    tools = (
        own_tool("Own", "2.0", adding(1.0, 0.5)),
        own_tool("Other", "1.1", adding(1.5, 2.0), peer=True),
        Tool("Missing", "1.0", missing),
        own_tool("Failing", "0.1", "raise SystemExit('no such thing')", peer=True),
    )
    return Case("adding", "three numbers", prepare, judge, tools)


def test_each_tool_is_judged_on_the_same_files_and_reasons_take_the_place_of_figures(case):
    kept = []
    found = peer_comparison.compare(case, 2, {}, kept.append)
    assert kept == found
    own, other, gone, failed = found
    assert (own.own, own.error, own.accuracy, own.cpu, own.seconds, own.runs) == (True, 0.0, "0.0 off", 0.5, 1.0, 2)
    assert (other.own, other.error, other.cpu) == (False, 0.5, 2.0)
    assert 5e6 < own.peak < 1e9
    assert gone.reason == "any==1.0 cannot be installed: No matching distribution found"
    assert failed.reason == "failed (1): no such thing"
    assert gone.error is None
    assert failed.runs == 0


def test_the_table_has_a_row_for_each_tool_with_its_share_of_slopewatchs(case):
    rows = [
        Outcome("adding", "three", "Other", "1.1", error=0.5, accuracy="0.5 off", cpu=2.0, seconds=3.0, peak=10**8),
        Outcome("adding", "three", "Own", "2.0", True, 0.0, "0.0 off", cpu=0.5, seconds=1.0, peak=2 * 10**8),
        Outcome("adding", "three", "Missing", "1.0", reason="no wheel"),
    ]
    lines = peer_comparison.table(rows).splitlines()[2:]
    assert lines == [
        "| adding, three | Own 2.0 | 0.0 off | 0.50 s | 1.00 s | 0.20 GB |  |",
        "| adding, three | Other 1.1 | 0.5 off | 2.00 s | 3.00 s | 0.10 GB | 4 x, 0.5 x |",
        "| adding, three | Missing 1.0 | not measured: no wheel | | | | |",
    ]


def test_a_run_goes_on_with_what_has_no_row(case, tmp_path, monkeypatch, capsys):
    prepared = []
    counted = Case("gridding", "three numbers", lambda f: prepared.append(f) or case.prepare(f), case.judge, case.tools)
    module = SimpleNamespace(cases=lambda quick: [counted])
    monkeypatch.setattr(peer_comparison.importlib, "import_module", lambda name: module)
    words = ["--results", str(tmp_path), "--stages", "gridding", "--quick"]
    assert peer_comparison.main(words) == 0
    first = (tmp_path / "peers_quick.jsonl").read_text(encoding="utf-8")
    assert len(prepared) == 1
    assert peer_comparison.main(words) == 0
    assert len(prepared) == 1
    assert (tmp_path / "peers_quick.jsonl").read_text(encoding="utf-8") == first
    (tmp_path / "peers_quick.jsonl").write_text("".join(first.splitlines(keepends=True)[:2]) + '{"stage": "gr')
    assert peer_comparison.main(words) == 0
    assert len(prepared) == 2
    document = json.loads((tmp_path / "peers_quick.json").read_text(encoding="utf-8"))
    assert [row["tool"] for row in document["rows"]] == ["Own", "Other", "Missing", "Failing"]
    assert {"day", "machine"} <= document.keys()
    assert "| gridding, three numbers | Own 2.0 | 0.0 off |" in capsys.readouterr().out


def test_what_starting_takes_is_taken_off():
    tries = Tries(spent=[(5.0, 9.0), (4.0, 10.0)], base=[(1.5, 2.0), (1.0, 3.0)])
    assert (tries.cpu, tries.seconds) == (3.0, 7.0)


def test_a_peer_runs_in_its_own_interpreter_without_this_programs_packages(tmp_path, monkeypatch):
    monkeypatch.setattr(peers, "peer_python", lambda peer: Path(f"/envs/{peer}/bin/python"))
    monkeypatch.setattr("slopewatch.lab.benchmarks.peer_case.peer_python", peers.peer_python)
    command = script_tool("Name", "any", "1.0", "print(1)").command(tmp_path)
    assert command == ["/envs/any/bin/python", "-c", "print(1)", str(tmp_path)]


def test_the_judge_of_a_change_counts_unchanged_cells_beyond_their_level():
    true = np.array([[0.0, 0.0, 0.0, 0.5, 0.0]])
    dz = np.array([[0.03, -0.01, 0.0, 0.46, np.nan]])
    figures = judged(dz, np.full(dz.shape, 0.02), true)
    assert figures.value == pytest.approx(1000 * np.sqrt((0.03**2 + 0.01**2 + 0.04**2) / 4))
    assert "of 4 cells" in figures.text
    assert "33.3 % of unchanged cells" in figures.text


def test_hazards_put_in_move_the_points_that_are_labelled():
    side = np.arange(0, 40, 0.4)
    x, y = (axis.ravel() for axis in np.meshgrid(side, side))
    xyz = np.column_stack([x, y, 0.4 * y])
    found, label = with_hazards(xyz, 1)
    off = (found - xyz)[:, 2]
    assert set(np.unique(label)) == {0, 1, 2}
    assert (off[label == 1] > 0).all()
    assert (off[label == 2] < 0).all()
    assert np.abs(off[label == 0]).max() < 0.15


def test_a_raster_beside_the_grid_is_laid_where_its_corner_says():
    grid = Grid(100.0, 50.0, 2.0, 3, 2)
    height = np.arange(6.0).reshape(3, 2)
    np.testing.assert_array_equal(on(grid, height, 50.0, 100.0), height)
    south = on(grid, height, 48.0, 100.0)
    assert np.isnan(south[0]).all()
    np.testing.assert_array_equal(south[1:], height[:2])
    west = on(grid, height, 52.0, 98.0)
    np.testing.assert_array_equal(west[:2, 0], height[1:, 1])
    assert np.isnan(west[:, 1]).all()
    assert np.isnan(west[2]).all()


def test_intersection_over_union():
    found, true = np.array([1, 1, 0, 0], dtype=bool), np.array([1, 0, 1, 0], dtype=bool)
    assert iou(found, true) == pytest.approx(1 / 3)
    assert iou(~found & found, ~true & true) == 1.0


def test_the_interpreter_of_the_tests_is_the_one_of_own_tools(tmp_path):
    assert own_tool("a", "1", "x").command(tmp_path)[0] == sys.executable
