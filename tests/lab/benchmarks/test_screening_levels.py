"""Levels, calibration, factors of A70 and combined scores of the benchmark of screening by sites, by brute force."""

from __future__ import annotations

from dataclasses import replace

import laspy
import numpy as np
import pytest
import rasterio
from rasterio.transform import from_origin
from scipy.special import expit, logit
from slopewatch.engine.core.errors import InputError
from slopewatch.lab.benchmarks.screening_calibration import SCORES, calibrate, counted, fit_platt, hazard_odds
from slopewatch.lab.benchmarks.screening_cases import Cases, a70_factor
from slopewatch.lab.benchmarks.screening_combined import added, chosen_ways, combined, larger
from slopewatch.lab.benchmarks.screening_ground import ELEVATION, POINTS, own_places
from slopewatch.lab.benchmarks.screening_levels import far_from_hazards, far_zones, measure
from slopewatch.lab.benchmarks.screening_networks import relative
from slopewatch.lab.benchmarks.screening_trials import Lattice, PlaceResult, Trial
from slopewatch.tests.builders.screening_places import scored, somewhere


def brute_force(scores: np.ndarray, allowed: np.ndarray, level: float, cell: float) -> int:
    """Zones by flooding, one after the other."""
    above = {(int(i), int(j)) for i, j in zip(*np.nonzero(scores > level), strict=True)}
    count = 0
    while above:
        zone, edge = set(), [above.pop()]
        while edge:
            i, j = edge.pop()
            zone.add((i, j))
            near = {(i + a, j + b) for a in (-1, 0, 1) for b in (-1, 0, 1)} & above
            above -= near
            edge.extend(near)
        count += len(zone) * cell**2 >= 1.0 and all(allowed[one] for one in zone)
    return count


def rough_result(seed: int = 0) -> PlaceResult:
    """Two scenes of random scores with three hazards and a place with nothing put in."""
    rng = np.random.default_rng(seed)
    shape = (50, 40)
    answers = rng.normal(0, 1, (3, 2, *shape)).astype(np.float32)
    answers += 0.7 * (np.roll(answers, 1, -1) + np.roll(answers, 1, -2))
    covered = np.ones(shape, dtype=bool)
    covered[:, :3] = False
    answers[:, :, ~covered] = np.nan
    trials = []
    for number, (height, i, j) in enumerate(((0.5, 10, 10), (-0.5, 30, 25), (0.5, 40, 8), (1e-6, 15, 30))):
        cells = np.ravel_multi_index(np.mgrid[i : i + 4, j : j + 4].reshape(2, -1), shape)
        trials.append(Trial(height, 3.0, (0.0, 0.0), 0.4, number % 2, 1 + (height < 0), cells))
    return PlaceResult(somewhere("one"), Lattice(np.zeros(2), 0.5, covered), 0.4, 2, trials, {"one": answers}, "one")


def test_zones_of_changed_ground_are_those_that_brute_force_counts() -> None:
    result = rough_result()
    far = far_from_hazards(result)
    i, j = np.mgrid[:50, :40]
    for scene in (0, 1):
        hazards = [
            np.unravel_index(one.cells, (50, 40)) for one in result.trials if one.scene == scene and not one.empty
        ]
        assert len(hazards) == 2 - scene
        distance = np.min([np.hypot(i - a, j - b) for where in hazards for a, b in zip(*where, strict=True)], axis=0)
        np.testing.assert_array_equal(far[scene], (distance * 0.5 > 2.0) & result.lattice.covered)
    levels = np.linspace(0.0, 4.0, 9)
    scenes = result.answers["one"][1:]
    wanted = [sum(brute_force(score, far[k], level, 0.5) for k in (0, 1) for score in scenes[k]) for level in levels]
    assert max(wanted) > 10
    assert far_zones(scenes, far, levels, 0.5).tolist() == wanted
    # From above on up to the first level with more than are asked for.
    kept = far_zones(scenes, far, levels, 0.5, most=5.0)
    first = max(k for k, count in enumerate(wanted) if count > 5)
    assert kept[first:].tolist() == wanted[first:]
    assert (kept[:first] == wanted[first]).all()


def test_the_level_of_changed_ground_counts_what_is_far_from_hazards() -> None:
    """Forty false zones of the scene; those on hazards, however high, are none."""
    surveys = [
        scored(f"{k}", f"{k}", list(np.linspace(2, 4, 40)), [50.0, 70.0, 90.0], changed=list(np.linspace(20, 40, 40)))
        for k in range(3)
    ]
    found = measure(surveys, [one.answers["one"] for one in surveys])
    for one in surveys:
        figures = found.figures[one.place.name]
        assert figures.others == pytest.approx(3.5, abs=0.1)
        assert figures.changed_others == pytest.approx(35.0, abs=1.0)
        assert figures.changed_own == pytest.approx(35.0, abs=1.0)
        assert 9_800 < figures.changed_area < 10_000
        assert figures.false_changed == pytest.approx(1000 * 40 / figures.changed_area)
        assert found.found(one.place.name, "changed_others").tolist() == [True] * 3


def test_platt_scaling_finds_the_odds_that_made_the_data() -> None:
    rng = np.random.default_rng(0)
    score = rng.normal(0, 3, 200_000)
    truth = rng.random(len(score)) < expit(0.8 * score - 1.5)
    fit = fit_platt(score, truth.astype(float), (~truth).astype(float))
    assert (fit.scale, fit.shift) == pytest.approx((0.8, -1.5), abs=0.03)
    assert fit(np.array([2.0]))[0] == pytest.approx(expit(0.1), abs=0.01)
    # Weights: twice as many positives shift the odds by the logarithm of two.
    twice = fit_platt(score, 2.0 * truth, (~truth).astype(float))
    assert twice.shift - fit.shift == pytest.approx(np.log(2), abs=0.01)


def test_odds_of_a_hazard_are_those_of_both_signs() -> None:
    logits = np.random.default_rng(1).normal(0, 4, (3, 1000))
    share = np.exp(logits) / np.exp(logits).sum(axis=0)
    both = np.stack([logit(share[1]), logit(share[2])])
    np.testing.assert_allclose(hazard_odds(both), logit(share[1] + share[2]), rtol=1e-6, atol=1e-6)


def test_calibration_of_a_survey_left_out_is_that_of_the_others() -> None:
    """Cells whose odds of a hazard are half of what they are called, where hazards cover three of a hundred."""
    results, counts = [], []
    for k in range(3):
        stated = 2.0 * (SCORES + 3.5)
        ground = np.exp(-((SCORES + 3.5) ** 2) / 8)
        share = expit(SCORES)
        results.append(replace(rough_result(), place=somewhere(f"{k}")))
        cells = np.zeros((2, len(SCORES)))
        number = np.clip(np.rint((stated - SCORES[0]) / 0.02), 0, len(SCORES) - 1).astype(int)
        for row, values in enumerate((ground * (1 - share), ground * share)):
            np.add.at(cells[row], number, values)
        counts.append(cells)
    prior = counts[0][1].sum() / counts[0].sum()
    [kind], fit = calibrate(results, counts)
    assert kind.kind == POINTS
    assert fit.scale == pytest.approx(0.5, abs=0.02)
    assert fit.shift == pytest.approx(-3.5 + logit(0.03) - logit(prior), abs=0.1)
    assert kind.before > 0.05
    assert kind.after < 0.005


def test_cells_are_counted_by_their_score_and_truth() -> None:
    result = rough_result()
    cells = counted(result, result.answers["one"], odds=False)
    hazard = sum(len(one.cells) for one in result.trials if not one.empty)
    assert cells.sum(axis=1).tolist() == [2 * 50 * 37 - hazard, hazard]
    scene = result.answers["one"][1:].max(axis=1)
    assert cells.sum(axis=0) @ SCORES == pytest.approx(float(np.nansum(scene)), abs=0.01 * 2 * 50 * 37)


def test_the_factor_of_a70_is_that_of_a_known_logistic() -> None:
    rng = np.random.default_rng(3)
    number = 6000
    ratio = np.exp(rng.uniform(np.log(0.2), np.log(6), number))
    # 70 % are found at 1.4 x A70.
    found = rng.random((2, number)) < expit(logit(0.7) + 2.5 * np.log(ratio / 1.4))
    place = np.repeat([f"{k}" for k in range(20)], number // 20)
    same = np.full(number, 0.5)
    told = Cases(place, place, place, same, 0.5 * ratio, same, same, {"one": {"others": found}})
    value, low, high = a70_factor(told, "one", np.ones(number, dtype=bool))
    assert value == pytest.approx(1.4, abs=0.05)
    assert low < value < high
    assert 0.02 < high - low < 0.3
    nothing = replace(told, found={"one": {"others": np.zeros_like(found)}})
    assert np.isnan(a70_factor(nothing, "one", np.ones(number, dtype=bool))[0])


def test_the_way_of_combining_is_the_others_best() -> None:
    """A survey has no say in how it is judged itself."""
    results = [scored(f"{k}", f"{k}", [], [2.0, 2.0]) for k in range(5)]
    flat = [one.answers["one"] for one in results]
    quiet = measure(results, flat)
    ways = {}
    for way, good in (("first", (0, 1, 4)), ("second", (2, 3))):
        strength = {f"{k}": np.array([2.0, 2.0 if k in good else -5.0]) for k in range(5)}
        ways[way] = [replace(quiet, strength=strength)]
    chosen, best = chosen_ways(results, ways)
    assert best == "first"
    assert [chosen[f"{k}"] for k in (2, 3)] == ["first", "first"]
    # Now three surveys each: a draw, which the first wins; without one of the first's own the second is ahead.
    ways["second"][0].strength["4"][1] = 2.0
    assert chosen_ways(results, ways)[0] == {
        "0": "second",
        "1": "second",
        "2": "first",
        "3": "first",
        "4": "first",
    }
    [joined] = combined(results, ways)
    assert joined.strength["0"].tolist() == [2.0, -5.0]
    assert joined.strength["2"].tolist() == [2.0, -5.0]
    assert joined.strength["4"].tolist() == [2.0, 2.0]


def test_scores_are_joined_cell_by_cell() -> None:
    first = np.array([[1.0, 2.0], [np.nan, 4.0]], dtype=np.float32)
    second = np.array([[8.0, 2.0], [np.nan, -4.0]], dtype=np.float32)
    np.testing.assert_array_equal(added(first, second, 0.25), [[3.0, 2.5], [np.nan, 3.0]])
    np.testing.assert_array_equal(larger(first, second, (2.0, 4.0)), [[2.0, 1.0], [np.nan, 2.0]])


def test_relative_scores_do_not_see_how_sure_a_network_is() -> None:
    answers = rough_result().answers["one"]
    surer, plain = relative(5.0 + 3.0 * answers, 0.5), relative(answers, 0.5)
    assert np.nanmax(np.abs(plain)) > 2
    np.testing.assert_allclose(surer, 3.0**0.3 * plain, rtol=1e-4, atol=1e-4)


def test_ground_of_ones_own_takes_part(tmp_path) -> None:
    rng = np.random.default_rng(4)
    xyz = np.column_stack([rng.uniform(0, 30, (4000, 2)), rng.normal(0, 0.03, 4000)])
    cloud = laspy.create(point_format=6, file_version="1.4")
    cloud.header.scales = [0.001] * 3
    cloud.x, cloud.y, cloud.z = xyz.T
    cloud.classification = np.where(np.arange(4000) < 2500, 2, 5).astype(np.uint8)
    cloud.write(tmp_path / "mine.laz")
    cloud.classification = np.ones(4000, dtype=np.uint8)
    cloud.write(tmp_path / "plain.las")
    height = (0.4 * np.arange(40)[:, None] + np.zeros((40, 40))).astype(np.float32)
    profile = {"driver": "GTiff", "height": 40, "width": 40, "count": 1, "dtype": "float32"}
    with rasterio.open(tmp_path / "model.tif", "w", transform=from_origin(0, 40, 1, 1), **profile) as target:
        target.write(height, 1)
    found = own_places([tmp_path / name for name in ("mine.laz", "plain.las", "model.tif")])
    assert [(one.group, one.kind, len(one.flat)) for one in found] == [
        ("mine", POINTS, 2500),
        ("plain", POINTS, 4000),
        ("model", ELEVATION, 1600),
    ]
    assert np.std(found[2].flat[:, 2]) < 0.01
    with pytest.raises(InputError, match=r"none\.laz is no LAS, LAZ or GeoTIFF file; give one that exists\.$"):
        own_places([tmp_path / "none.laz"])
    cloud.points = cloud.points[(xyz[:, 0] < 8) & (xyz[:, 1] < 8)]
    cloud.write(tmp_path / "small.las")
    with pytest.raises(InputError, match=r"small\.las covers less than 150 m²; give a larger one\.$"):
        own_places([tmp_path / "small.las"])
