"""The benchmark of screening by sites: its thresholds, what counts as found, and a small run on simulated ground."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from slopewatch.benchmarks import screening_ground, screening_sites, screening_trials
from slopewatch.benchmarks.screening_ground import POINTS, Place, patches, place
from slopewatch.benchmarks.screening_sites import as_json, budget_levels, judge, run_places, share, table
from slopewatch.benchmarks.screening_trials import PlaceResult, Trial, cell_means, filter_scores, network_scores
from slopewatch.engine.geometry.dominant_plane import apply_matrix
from slopewatch.models.preparation.raster_zones import Scores, zone_counts
from slopewatch.models.preparation.relief_raster import relief_raster


def scored(name: str, group: str, peaks: list[float], strengths: list[float], needed: float = 0.4) -> PlaceResult:
    """10,000 m² on which zones of 1 m² have the given scores, and a trial for each strength."""
    score = np.zeros((200, 200))
    for k, peak in enumerate(peaks):
        i, j = divmod(k, 20)
        score[i * 9 : i * 9 + 2, j * 9 : j * 9 + 2] = peak * (-1) ** k
    flat = np.column_stack([np.random.default_rng(0).uniform(0, 100, (500, 2)), np.zeros(500)])
    trials = [Trial(name, 0.5, 3.0, (0.0, 0.0), 0.4, {"one": value}) for value in strengths]
    where = Place(name, group, POINTS, flat, np.eye(4))
    return PlaceResult(where, 10_000.0, needed, {"one": Scores.signed(score, 0.5)}, trials)


def test_the_threshold_is_the_other_surveys_own() -> None:
    """Neither a survey's own places nor ground on which nothing can be found set its threshold."""
    rough = [scored(f"rough {k}", "rough", list(np.linspace(20, 40, 40)), [15.0, 25.0, 50.0]) for k in (1, 2)]
    smooth = [scored("smooth", "smooth", list(np.linspace(2, 4, 40)), [3.0, 15.0, 50.0])]
    hopeless = scored("hopeless", "hopeless", list(np.linspace(200, 400, 40)), [50.0], needed=1.4)
    outcome = judge([*rough, *smooth, hopeless])
    for one in rough:
        figures = outcome.sites[one.place.name]["one"]
        # Ten of forty peaks are above 3.5.
        assert figures.others == pytest.approx(3.5, abs=0.15)
        assert figures.own == pytest.approx(35.0, abs=1.5)
        assert figures.false_others == 4.0
        assert figures.false_own == pytest.approx(1.0, abs=0.15)
    assert outcome.sites["smooth"]["one"].others == pytest.approx(35.0, abs=1.5)
    assert outcome.sites["smooth"]["one"].false_others == 0.0
    assert [one.others["one"] for one in outcome.judged] == [True, True, True] * 2 + [False, False, True, True]
    assert [one.own["one"] for one in outcome.judged] == [False, False, True] * 2 + [False, True, True, False]


def test_shares_have_wilsons_interval() -> None:
    found, low, high, count = share([True] * 7 + [False] * 3)
    assert (found, count) == (0.7, 10)
    # Newcombe 1998, method 3.
    assert (low, high) == pytest.approx((0.3968, 0.8922), abs=1e-4)
    assert share([])[3] == 0


def test_a_small_run_on_simulated_slopes(capsys: pytest.CaptureFixture[str]) -> None:
    places = screening_ground.simulated_places(1, area=900.0)
    outcome = judge(run_places(places, [filter_scores], 1))
    assert "hazards" in capsys.readouterr().err
    assert {one.place.name for one in outcome.judged} == {one.name for one in places}
    # High ones are found more often than low ones by the matched filter.
    low, high = (
        np.mean([one.own["filter, t"] for one in outcome.judged if low <= abs(one.trial.height) <= high])
        for low, high in ((0.1, 0.2), (0.8, 1.2))
    )
    assert high > low + 0.3
    for trial in (one.trial for one in outcome.judged):
        assert 0.02 < trial.needed < 5
    kept = json.loads(json.dumps(as_json(outcome)))
    assert len(kept["hazards"]) == len(outcome.judged)
    assert kept["places"][0]["detectors"].keys() == outcome.results[0].scores.keys()
    rows = table(outcome)
    assert any("x A70" in row.figure for row in rows)
    assert any(row.figure.startswith("simulated shifted 1") for row in rows)


def test_the_levels_of_a_budget_are_those_that_other_surveys_give() -> None:
    """By hand: 40 peaks of each of four surveys; of three, two false zones may be counted on the fourth."""
    surveys = [scored(f"{k}", f"{k}", list(np.linspace(2, 4, 40) + 0.001 * k), []) for k in range(4)]
    found = {row.figure: row for row in budget_levels(surveys, "one")}
    one, ten = (found[f"level of one for {wanted} false zones per 1,000 m²"] for wanted in ("1", "10"))
    # 4 in 10,000 m² are 0.4; with three counted on a fifth slope (4 x 0.5 + 3) / 5 = 1: at most 5 of 40 are false.
    assert float(one.value) == pytest.approx(3.77, abs=0.03)
    # Three surveys allow (3 x 0.33 + 3) / 4: three false zones on the fourth.
    assert [float(part.split()[1]) for part in one.peer.split(", ")] == pytest.approx([0.3] * 4, abs=0.11)
    assert float(ten.value) < float(one.value)
    assert found["level of one for 0.1 false zones per 1,000 m²"].value == "none of 4 places"


def test_a_detector_that_knows_the_truth_finds_all(monkeypatch: pytest.MonkeyPatch) -> None:
    """Strengths come from the changed ground, false zones from the untouched one."""
    [ground] = screening_ground.simulated_places(1, area=600.0)[:1]
    before = ground.flat[:, 2].copy()

    def oracle(xyz: np.ndarray) -> np.ndarray:
        moved = apply_matrix(ground.matrix, xyz)[:, 2] - before
        return np.column_stack([np.abs(moved) <= 0.03, moved > 0.03, moved < -0.03]).astype(float)

    monkeypatch.setattr(screening_trials, "HEIGHTS_M", (0.5,))
    result = screening_trials.try_place(ground, [network_scores(oracle)], 2)
    assert len(result.trials) >= 6
    [name] = result.scores
    assert zone_counts(result.scores[name], np.array([0.01])).tolist() == [0.0]
    empty = [trial for trial in result.trials if abs(trial.height) <= screening_trials.NOTHING_M]
    assert empty
    assert not any(trial.strength[name] > 0.01 for trial in empty)
    assert all(trial.strength[name] > 0.3 for trial in result.trials if trial not in empty)


def test_cell_means_fill_small_gaps_only() -> None:
    rng = np.random.default_rng(1)
    flat = np.column_stack([rng.uniform(0, 20, (1500, 2)), rng.normal(0, 0.02, 1500)])
    flat = flat[np.hypot(flat[:, 0] - 10, flat[:, 1] - 10) > 4]
    raster = relief_raster(flat)
    mean = cell_means(flat, flat[:, 0], raster)
    assert np.isnan(mean[20, 20])
    middle = raster.origin[0] + (np.arange(raster.shape[0]) + 0.5) * raster.cell
    assert np.nanmax(np.abs(mean - middle[:, None])) < 1.3
    np.testing.assert_array_equal(np.isfinite(mean), raster.covered)


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
    from slopewatch.benchmarks.__main__ import KEPT, NAMES

    assert "screening_sites" in NAMES
    assert "screening_sites" in KEPT
    assert screening_sites.COUNT >= 12
