"""How the shipped model and its figures are made, in small."""

from __future__ import annotations

import csv
import json
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from slopewatch.models.configuration import SMOKE
from slopewatch.models.network.shipped import SHIPPED_WEIGHTS
from slopewatch.simulation.hazard_scenes.scenes import build_scene
from slopewatch.simulation.hazard_scenes.sets import FIRST_TRAINING_SEED, SETS, published_set
from slopewatch.simulation.hazard_scenes.styles import SIMULATOR_VERSION


@pytest.fixture
def recipe(torch):
    from slopewatch.models.training.recipes import Recipe
    from slopewatch.models.training.training import TrainingParameters

    small = replace(SMOKE, widths=(4, 8), trends=((4.0, 4.0),))
    return Recipe(small, TrainingParameters(steps=4, batch=2), step=15.0)


@pytest.fixture(scope="module")
def specs():
    return [replace(spec, area=220.0, density=25.0) for spec in published_set().specs[:6]]


def test_the_command_that_makes_the_weights_is_there():
    command = [sys.executable, "-m", "slopewatch.lab.making", "--help"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 0, done.stderr
    assert {"weights", "figures", "folds", "ablation", "card"} <= set(done.stdout.split())


def test_the_shipped_weights_are_of_todays_simulator():
    description = json.loads(SHIPPED_WEIGHTS.with_suffix(".json").read_text(encoding="utf-8"))
    assert description["simulator_version"] == SIMULATOR_VERSION


def test_each_scene_is_scored_once_by_a_model_that_never_saw_it(recipe, specs, tmp_path, monkeypatch):
    from slopewatch.lab.making import folds as benchmark_folds
    from slopewatch.lab.making.scene_blocks import scene_blocks
    from slopewatch.models.network.weights import load_model
    from slopewatch.models.training import recipes

    trained: list[set[int]] = []
    original = recipes.train

    def watched(configuration, provider, *rest, **named):
        trained.append({len(provider(step).labels) for step in range(40)})
        return original(configuration, provider, *rest, **named)

    # One block a batch, so that a block is known again by its number of points.
    single = replace(recipe, training=replace(recipe.training, batch=1))
    monkeypatch.setattr(recipes, "train", watched)
    summary = benchmark_folds.score_folds(specs, single, tmp_path, count=3)
    assert sum(fold["points"] for fold in summary["folds"]) == sum(len(build_scene(spec)) for spec in specs)
    assert sorted(k for fold in summary["folds"] for k in fold["test"]) == list(range(6))
    sizes = [{len(block) for block in scene_blocks(single, build_scene(spec))} for spec in specs]
    for fold, seen in zip(summary["folds"], trained):
        held_out = set.union(*(sizes[k] for k in fold["test"]))
        assert not held_out & seen
        assert seen == set.union(*(sizes[k] for k in range(6) if k not in fold["test"]))
    with (tmp_path / "fold_0" / "seconds.csv").open() as file:
        assert float(next(csv.DictReader(file))["training_s"]) > 0
    trained_on = [specs[k].seed for k in range(6) if k not in summary["folds"][0]["test"]]
    kept = load_model(tmp_path / "fold_0" / benchmark_folds.WEIGHTS_NAME)
    assert kept.metadata["training"]["scenes"] == trained_on
    # Scored folds are not trained again.
    monkeypatch.setattr(recipes, "train", None)
    assert benchmark_folds.score_folds(specs, single, tmp_path, count=3) == summary


def test_the_threshold_is_scored_on_the_same_folds(torch, specs, tmp_path):
    from slopewatch.lab.making.folds import score_residual
    from slopewatch.models.inference.baseline import residual_probabilities

    summary = score_residual(specs, tmp_path, count=3)
    right = points = 0
    for spec in specs:
        scene = build_scene(spec)
        right += int((residual_probabilities(scene.xyz).argmax(axis=1) == scene.label).sum())
        points += len(scene)
    folds = summary["folds"]
    assert sum(f["overall_accuracy"] * f["points"] for f in folds) == pytest.approx(right, abs=1e-4 * points)


def test_training_scenes_are_in_no_benchmark_set(torch):
    from slopewatch.lab.making.shipping import DENSITY, training_scenes

    chosen = list(training_scenes(60))
    assert {spec.kind for spec in chosen} == {"published", "realistic"}
    assert all(DENSITY[0] <= spec.density <= DENSITY[1] for spec in chosen)
    assert min(spec.density for spec in chosen) < 20 < 120 < max(spec.density for spec in chosen)
    scored = {spec.seed for make in SETS.values() for spec in make().specs}
    assert min(spec.seed for spec in chosen) >= FIRST_TRAINING_SEED > max(scored)
    assert chosen[7:9] == list(training_scenes(2, 7))


def test_some_training_scenes_have_more_hazards_and_nothing_else_differs(torch):
    from slopewatch.lab.making.shipping import BALANCED_SHARE, DENSE, DENSE_SHARE, training_scenes

    mixed, rare = list(training_scenes(400)), list(training_scenes(400, balanced=0.0, dense=0.0))
    assert {spec.kind for spec in rare} == {"realistic"}
    assert sum(spec.kind == "published" for spec in mixed) == pytest.approx(400 * BALANCED_SHARE, abs=25)
    denser = 0
    for spec, plain in zip(mixed, rare, strict=True):
        assert (spec.seed, spec.area, spec.density) == (plain.seed, plain.area, plain.density)
        if spec.kind == "realistic" and spec != plain:
            assert spec.uplift == pytest.approx(DENSE * plain.uplift)
            assert spec.subsidence == pytest.approx(DENSE * plain.subsidence)
            denser += 1
    # A fifth of the realistic kind has no hazards; four times none is none.
    assert denser == pytest.approx(0.8 * 400 * DENSE_SHARE, abs=35)
    spec = next(spec for spec, plain in zip(mixed, rare) if spec.kind == "realistic" and spec != plain)
    _, uplift, subsidence = build_scene(replace(spec, area=1500.0, density=25.0)).shares
    assert uplift == pytest.approx(spec.uplift, abs=0.03)
    assert subsidence == pytest.approx(spec.subsidence, abs=0.03)


def test_training_with_two_processes_gives_the_same_weights(recipe, tmp_path, monkeypatch):
    from slopewatch.lab.making import shipping

    monkeypatch.setattr(shipping, "SCENE_AREA", (150.0, 300.0))
    monkeypatch.setattr(shipping, "DENSITY", (20.0, 30.0))
    one, facts = shipping.train_shipped(recipe, tmp_path / "a", scenes=3)
    two, others = shipping.train_shipped(recipe, tmp_path / "b", scenes=3, processes=2)
    for a, b in zip(one.state_dict().values(), two.state_dict().values(), strict=True):
        np.testing.assert_array_equal(a.numpy(), b.numpy())
    measured = ("processor_seconds_preparing", "processor_seconds_training")
    assert {k: v for k, v in facts.items() if k not in measured} == {
        k: v for k, v in others.items() if k not in measured
    }


def test_every_point_of_a_set_is_scored(torch, specs, monkeypatch):
    from slopewatch.lab.making import shipping
    from slopewatch.models.inference.baseline import residual_probabilities
    from slopewatch.simulation.hazard_scenes.sets import BenchmarkSet

    few = BenchmarkSet("published", tuple(specs[:2]))
    monkeypatch.setitem(shipping.SETS, "published", lambda: few)
    found = shipping.score_set("published", None, 1.0)
    scenes = [build_scene(spec) for spec in few.specs]
    right = sum(int((residual_probabilities(s.xyz).argmax(axis=1) == s.label).sum()) for s in scenes)
    assert found["points"] == sum(map(len, scenes))
    assert found["overall_accuracy"] == pytest.approx(right / found["points"], abs=1e-4)


def test_a_training_that_ran_out_of_time_goes_on(recipe, tmp_path, monkeypatch):
    from slopewatch.lab.making import shipping

    monkeypatch.setattr(shipping, "SCENE_AREA", (150.0, 200.0))
    monkeypatch.setattr(shipping, "DENSITY", (20.0, 30.0))
    assert shipping.train_shipped(recipe, tmp_path / "a", scenes=3, seconds=0.0) is None
    network, facts = shipping.train_shipped(recipe, tmp_path / "a", scenes=3)
    whole, _ = shipping.train_shipped(recipe, tmp_path / "b", scenes=3)
    for a, b in zip(network.state_dict().values(), whole.state_dict().values(), strict=True):
        np.testing.assert_array_equal(a.numpy(), b.numpy())
    assert facts["steps"] == 4
    assert facts["scenes"] == 3
    assert facts["points"] > 500
