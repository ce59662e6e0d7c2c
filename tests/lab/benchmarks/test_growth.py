"""Power laws against known ones, slopes put end to end, and a run that goes on where it stopped."""

from __future__ import annotations

import math
from dataclasses import replace
from time import monotonic

import laspy
import numpy as np
import pytest
from slopewatch.engine.geometry.rigid_transform import RigidTransform
from slopewatch.lab.benchmarks import growth
from slopewatch.lab.benchmarks.growth_law import fitted
from slopewatch.lab.benchmarks.growth_report import draw, report
from slopewatch.lab.benchmarks.growth_store import Measured, append, read
from slopewatch.lab.benchmarks.long_slopes import OFFSET_M, frame_of, placed, write_long

SIZES = (1e6, 3e6, 1e7, 3e7, 1e8)


def row(millions: int, stage: str = "ground", **values) -> Measured:
    given = {"points": millions * 10**6, "cpu": 2.0 * millions, "seconds": 4.0 * millions, "together": 10**9}
    return Measured(millions, stage, 180.0, **{**given, **values})


def test_a_power_law_is_found_exactly():
    law = fitted(SIZES, [3e-5 * n**1.07 for n in SIZES])
    assert law.exponent == pytest.approx(1.07, abs=1e-12)
    assert law.factor == pytest.approx(3e-5, rel=1e-9)
    assert law.error < 1e-9
    assert law(2e7) == pytest.approx(3e-5 * 2e7**1.07)


def test_the_stated_error_of_an_exponent_is_its_scatter():
    random = np.random.default_rng(3)
    laws = [fitted(SIZES, [n * math.exp(random.normal(0, 0.1)) for n in SIZES]) for _ in range(2000)]
    exponents = np.array([law.exponent for law in laws])
    assert exponents.mean() == pytest.approx(1.0, abs=0.003)
    # the mean of squared standard errors is the variance of what they are the errors of
    assert np.sqrt(np.mean([law.error**2 for law in laws])) == pytest.approx(exponents.std(), rel=0.06)


@pytest.mark.parametrize("values", [(1.0, 2.0), (1.0, 2.0, 0.0), (1.0, 2.0, 3.0, 4.0)])
def test_what_no_law_goes_through_is_refused(values):
    with pytest.raises(ValueError, match="power law"):
        fitted(SIZES[:3] if len(values) != 2 else SIZES[:2], values)


def test_the_cells_of_a_change_stand_in_the_table():
    text = report(
        [row(1, "change", cell_m=0.1), row(3, "change", cell_m=0.25), row(1, "register", error_mm=1.5)], {}, {}
    )
    assert [line.split("|")[-2].strip() for line in text.splitlines() if " M | " in line] == [
        "0.1 m",
        "0.25 m",
        "1.50 mm",
    ]


def test_changes_with_larger_cells_do_not_enter_the_law():
    rows = [row(millions, "change", cpu=millions**1.1, cell_m=0.1) for millions in (3, 1, 10)]
    rows += [row(100, "change", cpu=1.0, cell_m=0.25), row(1), row(3), row(100)]
    laws = growth.laws_of(growth.series_of(growth.of_one_cell(rows)), 1)
    assert laws["change"].exponent == pytest.approx(1.1)
    assert laws["ground"].exponent == pytest.approx(1.0)
    assert len(growth.series_of(rows)["change"]) == 4


def test_pieces_meet_without_a_step():
    local = np.array([[0.0, 1.0, 2.0], [10.0, 3.0, 4.0], [4.0, 5.0, 6.0]])
    first, second, third = (placed(local, number, 10.0) for number in range(3))
    np.testing.assert_allclose(second[:, 0], [20.0, 10.0, 16.0])
    np.testing.assert_allclose(third[:, 0], [20.0, 30.0, 24.0])
    for left, right, edge in ((first, second, 10.0), (second, third, 20.0)):
        np.testing.assert_allclose(left[left[:, 0] == edge], right[right[:, 0] == edge])


def test_a_long_survey_holds_every_copy_with_all_that_was_recorded(tmp_path):
    frame, length = frame_of(180.0), 10.0
    local = np.random.default_rng(1).uniform((0, 0, 0), (length, 8, 5), (500, 3))
    piece = laspy.create(point_format=7, file_version="1.4")
    piece.header.scales, piece.header.offsets = [0.001] * 3, [500_000, 3_500_000, 0]
    piece.add_extra_dim(laspy.ExtraBytesParams("plants", np.uint8))
    piece.x, piece.y, piece.z = frame.to_world(local).T
    piece.plants = np.arange(500) % 251
    piece.write(tmp_path / "piece.las")
    for moved in (False, True):
        count = write_long(tmp_path / "piece.las", tmp_path / "long.las", 3, frame, moved, length)
        long = laspy.read(tmp_path / "long.las")
        assert count == len(long.points) == 1500
        expected = np.vstack([placed(local, number, length) for number in range(3)])
        found = frame.to_local(np.asarray(long.xyz) + moved * OFFSET_M)
        assert np.abs(found - expected).max() < 0.0011
        np.testing.assert_array_equal(long.plants, np.tile(np.arange(500) % 251, 3))


def test_a_part_of_a_piece_is_that_next_to_the_one_before(tmp_path):
    frame, length = frame_of(180.0), 10.0
    piece = laspy.create(point_format=7, file_version="1.4")
    piece.header.scales, piece.header.offsets = [0.001] * 3, [500_000, 3_500_000, 0]
    local = np.column_stack([np.arange(0.5, 10.0), np.zeros(10), np.zeros(10)])
    piece.x, piece.y, piece.z = frame.to_world(local).T
    piece.write(tmp_path / "piece.las")
    assert write_long(tmp_path / "piece.las", tmp_path / "long.las", 1.3, frame, moved=False, length=length) == 13
    found = frame.to_local(np.asarray(laspy.read(tmp_path / "long.las").xyz))[:, 0]
    np.testing.assert_allclose(np.sort(found), np.arange(0.5, 13.0), atol=0.0011)


def test_rows_come_back_even_after_a_line_that_was_cut_short(tmp_path):
    store = tmp_path / "growth.jsonl"
    append(store, row(1))
    store.write_text(store.read_text() + '{"millions": 3, "sta', encoding="utf-8")
    append(store, row(10, reason="not run: too long"))
    append(store, row(10))
    assert read(store) == {row(1).key: row(1), row(10).key: row(10)}
    assert read(tmp_path / "none.jsonl") == {}


@pytest.mark.parametrize(
    ("reason", "final"),
    [("", True), ("failed (2): too large", True), ("ended when it held 9 GB", True)]
    + [("not run: it would take some 30 minutes by the clock", False), ("ended after 60 s", False)],
)
def test_what_more_time_may_bring_is_tried_again(reason, final):
    assert row(1, reason=reason).final is final


def test_time_is_foreseen_from_the_largest_size_of_the_same_stage():
    known = [row(1), row(3), row(10, "change"), row(30, reason="failed"), replace(row(100), azimuth=150.0)]
    assert growth.expected_s((30, "ground", 180.0), known) == pytest.approx(120.0)
    assert growth.expected_s((30, "register", 180.0), known) is None


def test_a_run_goes_on_where_it_stopped_and_says_what_it_leaves(tmp_path, monkeypatch, capsys):
    asked = []

    def measure(key, clouds, known, deadline):
        asked.append(key[:2])
        assert deadline > monotonic()
        return row(*key[:2]) if key[0] < 30 else row(*key[:2], reason="not run: it would take long")

    monkeypatch.setattr(growth, "measure", measure)
    words = ["--results", str(tmp_path), "--sizes", "1", "3", "10", "30", "--stages", "ground"]
    append(tmp_path / "growth.jsonl", row(3))
    assert growth.main(words) == 0
    assert asked == [(1, "ground"), (10, "ground"), (30, "ground")]
    asked.clear()
    assert growth.main(words) == 0
    assert asked == [(30, "ground")]
    text = (tmp_path / "growth.md").read_text(encoding="utf-8")
    assert "| ground | 30 M | | not run: it would take long |" in text
    assert "| ground | n^1.000 (standard error 0.000) |" in text
    assert text in capsys.readouterr().out
    assert (tmp_path / "growth.png").read_bytes().startswith(b"\x89PNG")


def test_time_that_grows_too_fast_is_a_failure(tmp_path):
    for millions in (1, 3, 10):
        append(tmp_path / "growth.jsonl", row(millions, cpu=millions**1.2))
    words = ["--results", str(tmp_path), "--sizes", "1", "3", "10", "--stages", "ground"]
    assert growth.main(words) == 1


def test_nothing_is_started_without_time(tmp_path, monkeypatch):
    monkeypatch.setattr(growth, "measured", lambda *_, **__: pytest.fail("started"))
    found = growth.measure((30, "ground", 180.0), tmp_path, {row(10).key: row(10)}, monotonic() + 60)
    assert found.reason == "not run: it would take some 2 minutes by the clock"
    assert not found.final


def test_the_error_of_a_registration_is_that_over_the_slope():
    truth = RigidTransform(np.eye(3), OFFSET_M, np.zeros(3))
    assert growth.registration_mm(truth, 3, 180.0) == pytest.approx(0.0, abs=1e-6)
    off = replace(truth, translation=OFFSET_M + [0.003, 0.0, 0.004])
    assert growth.registration_mm(off, 3, 180.0) == pytest.approx(5.0, abs=1e-6)


def test_rows_of_a_table_name_size_memory_and_error():
    rows = [row(1, "register", peak=5 * 10**8, error_mm=1.234, day="2026-01-02", code="1.0 abc")]
    text = report(rows, {}, {})
    assert "| register | 1 M | 1.00 M | 2 s | 4 s | 2.0 s | 0.50 GB | 1.00 GB | 1.23 mm |" in text
    assert "Measured 2026-01-02 on SlopeWatch 1.0 abc." in text


def test_the_picture_has_a_stage_without_a_law_too(tmp_path):
    draw(tmp_path / "growth.png", {"ground": [(1e6, 2.0, 1e9)]}, {}, {})
    assert (tmp_path / "growth.png").stat().st_size > 5000
