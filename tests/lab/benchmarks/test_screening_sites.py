"""The benchmark of screening by sites: its levels, what counts as found, and a small run on simulated ground."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from scipy.special import logit
from slopewatch.engine.core.errors import InputError
from slopewatch.engine.geometry.dominant_plane import apply_matrix
from slopewatch.lab.benchmarks import screening_ground, screening_sites, screening_trials
from slopewatch.lab.benchmarks.screening_budget import budget_levels, detector_levels
from slopewatch.lab.benchmarks.screening_cases import cases, share
from slopewatch.lab.benchmarks.screening_ground import ELEVATION, POINTS, SIMULATED, patches, place
from slopewatch.lab.benchmarks.screening_levels import measure
from slopewatch.lab.benchmarks.screening_networks import FURTHER, POINT_ZONES, RANDLA, further_networks
from slopewatch.lab.benchmarks.screening_sites import as_json, judge, main_rows
from slopewatch.lab.benchmarks.screening_store import kept_place
from slopewatch.lab.benchmarks.screening_table import sections, text
from slopewatch.lab.benchmarks.screening_trials import network_scores, strengths
from slopewatch.models.configuration import SMOKE
from slopewatch.models.network.randlanet import RandLANet
from slopewatch.models.network.weights import save_model
from slopewatch.models.preparation import even_scores, point_scores, relative_scores
from slopewatch.models.preparation.raster_zones import Scores, zone_counts
from slopewatch.tests.builders.screening_places import scored, square


def heights(ground, raster):
    (mean,) = point_scores.cell_means(
        ground.flat[:, 2:], raster.index(ground.flat), np.ones(len(ground.flat)), raster.covered
    )
    return {"heights": Scores.signed(mean, raster.cell)}


def test_the_threshold_is_the_other_surveys_own() -> None:
    """Neither a survey's own places nor ground on which nothing can be found set its threshold."""
    rough = [scored(f"rough {k}", "rough", list(np.linspace(20, 40, 40)), [15.0, 25.0, 50.0]) for k in (1, 2)]
    smooth = [scored("smooth", "smooth", list(np.linspace(2, 4, 40)), [3.0, 15.0, 50.0])]
    hopeless = scored("hopeless", "hopeless", list(np.linspace(200, 400, 40)), [50.0], needed=1.4)
    results = [*rough, *smooth, hopeless]
    found = measure(results, [one.answers["one"] for one in results])
    for one in rough:
        figures = found.figures[one.place.name]
        # Ten of forty peaks are above 3.5.
        assert figures.others == pytest.approx(3.5, abs=0.15)
        assert figures.own == pytest.approx(35.0, abs=1.5)
        assert figures.false_others == 4.0
        assert figures.false_own == pytest.approx(1.0, abs=0.15)
        assert found.found(one.place.name).tolist() == [True, True, True]
        assert found.found(one.place.name, "own").tolist() == [False, False, True]
    assert found.figures["smooth"].others == pytest.approx(35.0, abs=1.5)
    assert found.figures["smooth"].false_others == 0.0
    assert found.found("smooth").tolist() == [False, False, True]
    assert found.found("smooth", "own").tolist() == [False, True, True]
    assert found.found("hopeless").tolist() == [True]
    assert found.found("hopeless", "own").tolist() == [False]


def test_clouds_and_simulated_slopes_have_one_level_and_elevation_models_their_own() -> None:
    """Ten false zones are allowed on the 10,000 m² of one other survey, twenty on two."""
    cloud, slope = (
        scored(name, name, list(np.linspace(low, low + 20, 40)), [low + 12.0], kind=kind)
        for name, low, kind in (("cloud", 20.0, POINTS), ("slope", 40.0, SIMULATED))
    )
    models = [scored(f"m{k}", f"m{k}", list(np.linspace(80, 100, 40)), [], kind=ELEVATION) for k in (1, 2)]
    results = [cloud, slope, *models]
    figures = measure(results, [one.answers["one"] for one in results]).figures
    assert figures["cloud"].others == pytest.approx(55.0, abs=1.0)
    assert figures["slope"].others == pytest.approx(35.0, abs=1.0)
    assert figures["m1"].others == pytest.approx(95.0, abs=1.0)
    third = scored("third", "third", [], [])
    # 20 zones on the two others together: of 80 peaks from 20 to 60 the 20 highest.
    figures = measure([cloud, slope, third], [one.answers["one"] for one in (cloud, slope, third)]).figures
    assert figures["third"].others == pytest.approx(50.0, abs=1.0)


def test_shares_have_wilsons_interval() -> None:
    found = share(np.array([[True] * 7 + [False] * 3]))
    assert (found.value, found.number) == (0.7, 10)
    # Newcombe 1998, method 3.
    assert (found.low, found.high) == pytest.approx((0.3968, 0.8922), abs=1e-4)
    assert str(share(np.zeros((1, 0), dtype=bool))) == "-"
    # Seeds do not make hazards more: the mean of 9 and 5 of 10 has the interval of 7 of 10.
    seeds = share(np.array([[True] * 9 + [False], [True] * 5 + [False] * 5]))
    assert (seeds.value, seeds.least, seeds.most) == (0.7, 0.5, 0.9)
    assert str(seeds) == "70 % (40 to 89; 50 to 90)"


def test_a_small_run_on_simulated_slopes(tmp_path, capsys: pytest.CaptureFixture[str]) -> None:
    places = screening_ground.simulated_places(1, area=900.0)
    results = [kept_place(tmp_path, one, {}, 1) for one in places]
    judged = judge(results, {}, keep=tmp_path)
    said = capsys.readouterr().err
    assert said.count("hazards and filters") == 3
    # High ones are found more often than low ones by the matched filter.
    told = cases(results, judged.measured)
    low, high = (
        told.found["filter, t"]["own"][0, (told.height >= low) & (told.height <= high)].mean()
        for low, high in ((0.1, 0.2), (0.8, 1.2))
    )
    assert high > low + 0.3
    for trial in (trial for one in results for trial in one.trials):
        assert 0.02 < trial.needed < 5
    kept = json.loads(json.dumps(as_json(judged, [])))
    assert sum(len(one["hazards"]) for one in kept["places"]) == len(told.height)
    assert kept["places"][0]["detectors"].keys() == judged.measured.keys()
    shown = text(sections(judged), lambda: "")
    assert "Hazards found on simulated slopes" in shown
    assert "| simulated shifted 1" in shown
    assert any("x A70" in row.figure for row in main_rows(judged))
    # What is kept is read again instead of made again, and gives the same.
    again = judge([kept_place(tmp_path, one, {}, 1) for one in places], {})
    assert "hazards and filters" not in capsys.readouterr().err
    assert as_json(again, [])["places"] == as_json(judged, [])["places"]


def test_the_levels_of_a_budget_are_those_that_other_surveys_give() -> None:
    """By hand: 40 peaks of each of four surveys; of three, two false zones may be counted on the fourth."""
    surveys = [scored(f"{k}", f"{k}", list(np.linspace(2, 4, 40) + 0.001 * k), []) for k in range(4)]
    rows = detector_levels(surveys, "one", lambda survey: survey.answers["one"][0], even_scores.LEVELS)
    found = {row.figure: row for row in rows}
    one, ten = (found[f"level of one for {wanted} false zones per 1,000 m²"] for wanted in ("1", "10"))
    # 4 in 10,000 m² are 0.4; with three counted on a fifth slope (4 x 0.5 + 3) / 5 = 1: at most 5 of 40 are false.
    assert float(one.value) == pytest.approx(3.77, abs=0.03)
    # Three surveys allow (3 x 0.33 + 3) / 4: three false zones on the fourth.
    assert [float(part.split()[1]) for part in one.peer.split(", ")] == pytest.approx([0.3] * 4, abs=0.11)
    assert float(ten.value) < float(one.value)
    assert found["level of one for 0.1 false zones per 1,000 m²"].value == "none of 4 places"


def test_the_filter_has_levels_and_the_network_on_relief_where_it_took_part() -> None:
    surveys = [scored(f"{k}", f"{k}", list(np.linspace(2, 4, 40) + 0.001 * k), []) for k in range(4)]
    of_filter = [replace(one, answers={"filter, even t": one.answers["one"]}) for one in surveys]
    assert {row.figure.split(" for ")[0] for row in budget_levels(of_filter)} == {"level of filter, even t"}
    both = [replace(one, answers={**one.answers, "U-Net 12ab": next(iter(one.answers.values()))}) for one in of_filter]
    rows = budget_levels(both)
    assert len(rows) == len(even_scores.LEVELS) + len(relative_scores.LEVELS)
    assert {row.figure.split(" for ")[0] for row in rows[-3:]} == {"level of U-Net, relative"}
    assert f"{relative_scores.LEVELS[10.0]:g} in use" in rows[-1].target


def test_the_network_on_points_has_levels_of_its_zones_as_they_are_shown() -> None:
    """Two peaks of one sign each stand on a plateau above the outline: half as many zones pass a level."""
    surveys = [scored(f"{k}", f"{k}", list(np.linspace(5, 9, 40) + 0.001 * k), []) for k in range(4)]
    names = {"filter, even t": "one", f"{RANDLA} 12ab": "one"}
    took_part = [replace(one, answers={name: one.answers[of] for name, of in names.items()}) for one in surveys]
    rows = [row for row in budget_levels(took_part) if row.figure.startswith(f"level of {POINT_ZONES} ")]
    assert [row.target for row in rows] == [f"{level:g} in use" for level in point_scores.LEVELS.values()]

    def ones(outline: float) -> float:
        found = detector_levels(joined, "x", lambda one: one.answers["one"][0], {1.0: 0.0}, outline)
        return float(found[0].value)

    joined = [replace(one, answers={"one": plateau(one.answers["one"])}) for one in surveys]
    # 5 zones of 40 may be false, or 5 of 20.
    assert ones(np.inf) == pytest.approx(8.51, abs=0.05)
    assert ones(2.0) == pytest.approx(8.0, abs=0.1)


def plateau(answers: np.ndarray) -> np.ndarray:
    """Scores in which ground of 3 joins the peaks 0 and 2, and 1 and 3, of every four."""
    raised = answers.copy()
    for number in (n for n in range(40) if n % 4 < 2):
        i, j = np.divmod(square(number), answers.shape[2])
        ground = raised[:, :, i.min() : i.max() + 1, j.min() : j.min() + 20]
        np.maximum(ground, 3.0, out=ground)
    return raised


def test_a_detector_that_knows_the_truth_finds_all(monkeypatch: pytest.MonkeyPatch) -> None:
    """Strengths come from the changed ground, false zones from the untouched one."""
    [ground] = screening_ground.simulated_places(1, area=600.0)[:1]
    before = ground.flat[:, 2].copy()

    def oracle(xyz: np.ndarray) -> np.ndarray:
        moved = apply_matrix(ground.matrix, xyz)[:, 2] - before
        return np.column_stack([np.abs(moved) <= 0.03, moved > 0.03, moved < -0.03]).astype(float)

    monkeypatch.setattr(screening_trials, "HEIGHTS_M", (0.5,))
    result = screening_trials.try_place(ground, [network_scores(oracle, "oracle")], 2)
    assert len(result.trials) >= 6
    answers = result.answers["oracle"]
    # Log odds: the shares of points of a cell that rise or sink are above these.
    seldom, often = logit(0.01), logit(0.3)
    assert zone_counts(Scores(*answers[0], result.lattice.cell), np.array([seldom])).tolist() == [0.0]
    found = strengths(result.trials, answers, result.lattice.cell)
    empty = np.array([trial.empty for trial in result.trials])
    assert empty.any()
    assert (found[empty] <= seldom).all()
    assert (found[~empty] > often).all()


def test_a_further_detector_sees_the_same_scenes() -> None:
    [ground] = screening_ground.simulated_places(1, area=600.0)[:1]
    together = screening_trials.try_place(ground, [heights], 1)
    later = screening_trials.answer(screening_trials.try_place(ground, [], 1), heights, 1)
    np.testing.assert_array_equal(later["heights"], together.answers["heights"])
    assert together.scenes == len(later["heights"]) - 1 >= 1
    # The mean height rises where a bulge was put in.
    [highest] = sorted((one for one in together.trials if one.label == 1), key=lambda one: one.height)[-1:]
    change = later["heights"][1 + highest.scene, 0] - later["heights"][0, 0]
    assert change.ravel()[highest.cells].max() == pytest.approx(highest.height, rel=0.2)


def test_patches_are_full_squares_of_the_cloud() -> None:
    rng = np.random.default_rng(2)
    xyz = np.column_stack([rng.uniform(0, 200, (80_000, 2)), rng.normal(0, 0.1, 80_000)])
    xyz = xyz[xyz[:, 0] + xyz[:, 1] < 260]
    found = list(patches(xyz, 60.0, 3))
    assert len(found) == 3
    for patch in found:
        assert (np.ptp(patch[:, :2], axis=0) <= 60).all()
        assert len(patch) > 0.8 * 2 * 60**2
    small = xyz[(xyz[:, :2] < 70).all(axis=1)]
    assert next(patches(small, 60.0, 3)) is small


def test_places_lie_flat_whatever_their_slope() -> None:
    rng = np.random.default_rng(3)
    xy = rng.uniform(0, 40, (6000, 2))
    xyz = np.column_stack([xy, 0.8 * xy[:, 1] + rng.normal(0, 0.05, len(xy))]) + [4e5, 5e6, 100.0]
    ground = place("a", "a", POINTS, xyz)
    assert np.std(ground.flat[:, 2]) < 0.06
    assert np.corrcoef(ground.flat[:, 1], xyz[:, 2])[0, 1] > 0.99
    assert replace(ground, flat=ground.flat[::2]).density < ground.density


def test_the_benchmark_is_listed() -> None:
    from slopewatch.lab.__main__ import KEPT, NAMES

    assert "screening_sites" in NAMES
    assert "screening_sites" in KEPT
    assert screening_sites.COUNT >= 12


def test_a_further_network_is_a_column_by_its_own_level() -> None:
    """Scores ten times as high have a level ten times as high, and the same is found."""
    surveys = [scored(f"{k}", f"{k}", list(np.linspace(2, 4, 40)), [3.0, 15.0]) for k in range(3)]
    results = [replace(one, answers={**one.answers, "points 12ab": 10 * one.answers["one"]}) for one in surveys]
    column = f"{FURTHER}paper 12ab"
    judged = judge(results, {}, further={column: "points 12ab"})
    assert list(judged.measured) == [column]
    [run] = judged.measured[column]
    plain = measure(results, [one.answers["one"] for one in results])
    assert run.figures["0"].others == pytest.approx(10 * plain.figures["0"].others)
    assert run.found("0").tolist() == plain.found("0").tolist() == [False, True]
    heads = {name for section in sections(judged) for name in section.head}
    assert column in heads


def test_weights_of_further_networks_are_read_and_not_twice(tmp_path: Path) -> None:
    path = tmp_path / "network.safetensors"
    torch.manual_seed(1)
    save_model(path, RandLANet(SMOKE), {}, {})
    [(column, (name, detector))] = further_networks([path]).items()
    assert column.startswith(f"{FURTHER}smoke ")
    [ground] = screening_ground.simulated_places(1, area=300.0)[:1]
    [scores] = detector(ground, screening_trials.relief_raster(ground.flat)).values()
    assert np.isfinite(scores.uplift).any()
    assert not name.startswith(RANDLA)  # the levels in use are those of the shipped weights alone
    few = replace(ground, flat=ground.flat[:20])
    [nothing] = detector(few, screening_trials.relief_raster(ground.flat)).values()
    assert np.nanmax(nothing.uplift) < np.nanmin(scores.uplift)  # refused as too few: background
    with pytest.raises(InputError, match="given twice"):
        further_networks([path, path])
