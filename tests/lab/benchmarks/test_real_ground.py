"""The figures of extracted ground, on clouds small enough to count by hand."""

from __future__ import annotations

import csv

import laspy
import numpy as np
import pytest
from slopewatch.lab.benchmarks import real_ground
from slopewatch.lab.benchmarks.ground_clouds import CASES, Case, Cloud, Seen, pulses, simulated_cloud
from slopewatch.lab.benchmarks.ground_figures import Result, Target, measured
from slopewatch.lab.benchmarks.ground_methods import Method, lowest_returns, smrf, write_las
from slopewatch.lab.benchmarks.peers import PeerMissingError
from slopewatch.lab.benchmarks.plants import over_ground_planes
from slopewatch.simulation.surveys.plot import grass_plot


def seen_of(xyz, number=None, total=None):
    """Points (n, 3) as a method sees them: single returns unless given."""
    ones = np.ones(len(xyz), dtype=np.uint8)
    return Seen(
        np.asarray(xyz, dtype=float), ones if number is None else number, ones if total is None else total, "ULS"
    )


def cloud_of(xyz, above, ground, slope=0.0, pulse=None):
    n = len(xyz)
    return Cloud(
        seen_of(xyz),
        np.asarray(above, dtype=float),
        np.full(n, slope),
        np.asarray(ground, dtype=bool),
        np.arange(n) if pulse is None else pulse,
    )


@pytest.fixture
def row_of_points():
    """Eight points 0.3 m apart: three of the ground, three within 20 cm of it, two above, in five cells of 0.5 m."""
    x = 0.1 + 0.3 * np.arange(8)
    above = np.array([0.0, 0.1, 0.02, -0.2, 1.0, 0.15, -0.01, 3.0])
    ground = np.array([1, 0, 1, 0, 0, 0, 1, 0], dtype=bool)
    return cloud_of(np.column_stack([x, np.zeros(8), above]), above, ground)


def test_heights_and_slopes_are_over_a_plane_of_eight_neighbours():
    rng = np.random.default_rng(4)
    xyz = rng.uniform(0.0, 10.0, (300, 3))
    ground = rng.random(300) < 0.4
    above, slope = over_ground_planes(xyz, ground)
    base = xyz[ground]
    for i in range(len(xyz)):
        near = base[np.argsort(np.hypot(*(base[:, :2] - xyz[i, :2]).T))[:8]]
        design = np.column_stack([near[:, :2] - xyz[i, :2], np.ones(8)])
        (a, b, c), *_ = np.linalg.lstsq(design, near[:, 2], rcond=None)
        assert above[i] == pytest.approx(xyz[i, 2] - c, abs=1e-6)
        assert slope[i] == pytest.approx(np.degrees(np.arctan(np.hypot(a, b))), abs=1e-6)


def test_figures_counted_by_hand(row_of_points):
    found = np.array([1, 1, 0, 0, 1, 0, 1, 0], dtype=bool)
    figures = measured([row_of_points], [found])
    assert figures.points == 4
    assert figures.recall == pytest.approx(2 / 3)
    assert figures.near == pytest.approx(3 / 4)
    assert (figures.median, figures.mean) == pytest.approx((0.05, (0.0 + 0.1 + 1.0 - 0.01) / 4))
    # the cells hold the points 0 1, 2, 3 4, 5 6 and 7 (x of 0.1 to 2.2 m): ground in the first, third and fourth
    assert figures.covered == pytest.approx(3 / 5)
    assert figures.bias == pytest.approx((0.05 + 1.0 - 0.01) / 3)
    assert figures.error == pytest.approx((0.05 + 1.0 + 0.01) / 3)


def test_a_part_counts_its_own_points_alone(row_of_points):
    found = np.array([1, 1, 0, 0, 1, 0, 1, 0], dtype=bool)
    part = np.array([0, 1, 1, 1, 1, 0, 0, 0], dtype=bool)
    figures = measured([row_of_points], [found], [part])
    assert (figures.points, figures.recall, figures.near) == (2, 0.0, 0.5)
    assert figures.covered == pytest.approx(2 / 3)


def test_clouds_of_a_case_are_measured_together(row_of_points):
    none, everything = np.zeros(8, dtype=bool), np.ones(8, dtype=bool)
    figures = measured([row_of_points, row_of_points], [none, everything])
    assert (figures.points, figures.recall, figures.covered) == (8, 0.5, 0.5)


def test_nothing_found_is_said_and_reaches_no_target(row_of_points):
    figures = measured([row_of_points], [np.zeros(8, dtype=bool)])
    assert (figures.points, figures.recall, figures.covered) == (0, 0.0, 0.0)
    assert figures.text() == "no ground"
    assert not Target(mean=1.0).met(figures)


def test_targets_limit_magnitudes_and_shares(row_of_points):
    figures = measured([row_of_points], [row_of_points.ground])
    assert Target(mean=0.05, p99=0.05, recall=1.0, near=1.0).met(figures)
    assert not Target(mean=0.003).met(figures)
    low = cloud_of(row_of_points.seen.xyz, row_of_points.above - 0.1, row_of_points.ground)
    assert not Target(mean=0.05).met(measured([low], [low.ground]))
    assert not Target(recall=0.9).met(measured([row_of_points], [row_of_points.above > 0.5]))


def test_returns_of_a_pulse_are_found_whatever_their_order():
    # a pulse a time: 3, 1 and 2 returns
    time = np.array([5.0, 5.0, 5.0, 6.0, 7.0, 7.0])
    number, total = np.array([1, 2, 3, 1, 1, 2]), np.array([3, 3, 3, 1, 2, 2])
    order = np.array([4, 2, 0, 5, 3, 1])
    found = pulses(time[order], np.zeros(6), number[order], total[order])
    assert [len(set(found[time[order] == t])) for t in (5.0, 6.0, 7.0)] == [1, 1, 1]
    assert len(set(found)) == 3


def test_pulses_of_one_time_are_told_apart_in_the_order_of_the_file():
    number, total = np.array([1, 2, 1, 1, 2, 1]), np.array([2, 2, 1, 2, 2, 1])
    found = pulses(np.zeros(6), np.zeros(6), number, total)
    assert found[0] == found[1]
    assert found[3] == found[4]
    assert len(set(found)) == 4
    assert len(set(pulses(np.zeros(6), np.array([1, 1, 1, 2, 2, 2]), number, total))) == 4


def test_thinning_keeps_pulses_whole():
    cloud = simulated_cloud(grass_plot(1, side=4.0, density=200.0))
    assert cloud.seen.total.max() > 1
    sizes = np.bincount(cloud.pulse)
    pulse_count = np.count_nonzero(sizes)
    kept = {share: cloud.thinned(share) for share in (0.5, 0.25)}
    for share, thinner in kept.items():
        numbers, counts = np.unique(thinner.pulse, return_counts=True)
        assert np.array_equal(counts, sizes[numbers])
        assert len(numbers) == round(share * pulse_count)
    assert set(kept[0.25].pulse) < set(kept[0.5].pulse)
    assert np.array_equal(kept[0.5].pulse, cloud.thinned(0.5).pulse)


def test_lowest_returns_are_those_of_a_search_cell_by_cell():
    rng = np.random.default_rng(7)
    seen = seen_of(rng.uniform(0.0, (6.0, 6.0, 2.0), (6000, 3)))
    found = lowest_returns(seen)
    side = np.sqrt(44.0 / seen.density)
    place = np.floor((seen.xyz[:, :2] - seen.xyz[:, :2].min(axis=0)) / side).astype(int)
    for cell in np.unique(place, axis=0):
        inside = np.flatnonzero((place == cell).all(axis=1))
        lowest = inside[np.argsort(seen.xyz[inside, 2])[: max(1, int(0.03 * len(inside)))]]
        assert set(np.flatnonzero(found[inside])) == set(np.searchsorted(inside, lowest))


def test_cells_of_the_lowest_returns_hold_about_44():
    made = simulated_cloud(grass_plot(1, side=6.0, density=700.0))
    assert made.seen.density == pytest.approx(700.0, rel=0.1)
    assert np.count_nonzero(lowest_returns(made.seen)) == pytest.approx(len(made) / 44, rel=0.3)


def test_a_written_cloud_holds_no_label(tmp_path):
    made = simulated_cloud(grass_plot(1, side=2.0, density=100.0))
    write_las(tmp_path / "seen.las", made.seen)
    las = laspy.read(tmp_path / "seen.las")
    assert not np.asarray(las.classification).any()
    assert np.array_equal(las.return_number, made.seen.number)
    assert np.array_equal(las.number_of_returns, made.seen.total)
    assert np.asarray(las.xyz) == pytest.approx(made.seen.xyz, abs=6e-4)


def test_smrf_parts_a_plain_from_what_stands_on_it():
    x, y = (part.ravel() for part in np.meshgrid(np.arange(0.0, 30.0, 0.5), np.arange(0.0, 30.0, 0.5)))
    high = (np.hypot(x - 15.0, y - 15.0) < 4.0) & (np.arange(len(x)) % 3 > 0)
    xyz = np.column_stack([x, y, 0.05 * x + np.where(high, 6.0, 0.0)])
    shuffled = np.random.default_rng(1).permutation(len(xyz))
    assert np.array_equal(smrf(seen_of(xyz[shuffled])), ~high[shuffled])


def test_the_simulated_plots_lie_on_their_true_surface():
    made = simulated_cloud(grass_plot(1, side=6.0, density=100.0, slope=25.0))
    assert float(np.median(made.slope)) == pytest.approx(25.0, abs=4.0)
    assert np.abs(made.above[made.ground]).max() < 0.2


@pytest.fixture
def two_cases(monkeypatch, row_of_points):
    """A small case that is there and one whose file is not; SlopeWatch finds four points, a peer others."""
    there = Case("here", "a row of points", lambda: (row_of_points,))
    away = Case("away", "a missing cloud", lambda: (), "terrain/there_is_no_such_cloud.laz")
    found = np.array([1, 1, 0, 0, 1, 0, 1, 0], dtype=bool)

    def missing(seen):
        raise PeerMissingError("it cannot be installed")

    monkeypatch.setattr(real_ground, "CASES", (there, away))
    monkeypatch.setattr(real_ground, "OWN", Method("SlopeWatch", lambda seen: found[: len(seen.xyz)]))
    monkeypatch.setattr(
        real_ground,
        "peers",
        lambda: (
            Method("higher", lambda seen: ~found, slow=True),
            Method("nothing", lambda seen: np.zeros(8, dtype=bool)),
            Method("absent", missing),
            Method("dense", lambda seen: found, dense_only=True),
        ),
    )


def test_the_table_compares_peers_and_names_what_is_missing(two_cases, tmp_path):
    table = {row.figure: row for row in real_ground.rows(tmp_path / "kept" / "real_ground.csv")}
    assert table["a missing cloud"].value.startswith("not measured: terrain/there_is_no_such_cloud.laz")
    assert "4 points" in table["a row of points"].value
    higher = table["here: mean height, compared with higher"]
    assert higher.met is True
    assert "4 points" in higher.peer
    assert table["here: mean height, compared with nothing"].met is None
    assert "cannot be installed" in table["here: mean height, compared with absent"].peer
    assert not any("compared with dense" in figure for figure in table)
    with (tmp_path / "kept" / "real_ground.csv").open() as file:
        lines = {(line["part"], line["method"]): line for line in csv.DictReader(file)}
    assert float(lines["all", "SlopeWatch"]["recall"]) == pytest.approx(2 / 3, abs=1e-5)
    assert lines["all", "higher"]["points"] == "4"
    assert ("density 0.5", "SlopeWatch") in lines


def test_a_choice_of_clouds_without_peers(two_cases):
    table = real_ground.rows(names=("here",), with_peers=False)
    assert [row.figure for row in table if "missing" in row.figure or "compared with" in row.figure] == []
    assert table[0].figure == "a row of points"


def test_slopes_with_too_few_points_of_the_reference_are_left_out(two_cases, monkeypatch, row_of_points):
    assert not any("slopes of" in row.figure for row in real_ground.rows(names=("here",), with_peers=False))
    monkeypatch.setattr(real_ground, "MIN_REFERENCE_POINTS", 3)
    known = real_ground.measure_all({"here": (row_of_points,)}, (real_ground.OWN,))
    assert {part for _, part, _ in known if part.startswith("slope")} == {"slope 0 to 15"}
    assert known["here", "slope 0 to 15", "SlopeWatch"].figures == known["here", "all", "SlopeWatch"].figures


def test_grown_less_mown_grass(row_of_points):
    higher = cloud_of(row_of_points.seen.xyz, row_of_points.above + 0.25, row_of_points.ground)
    known = {
        ("grass_grown_700", "all", "SlopeWatch"): Result(measured([higher], [higher.ground])),
        ("grass_mown_700", "all", "SlopeWatch"): Result(measured([row_of_points], [row_of_points.ground])),
        ("grass_grown_700", "all", "peer"): Result(measured([higher], [higher.ground])),
    }
    (row,) = real_ground.season_row(700, (real_ground.OWN, Method("peer", lowest_returns)), known)
    assert (row.value, row.peer) == ("+0.250 m", "")
    assert real_ground.season_row(40, (real_ground.OWN,), known) == []


def test_every_target_belongs_to_a_cloud():
    assert set(real_ground.TARGETS) <= {case.name for case in CASES}
