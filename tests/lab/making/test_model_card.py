"""The card says what the scores next to the weights say, and the ablation compares at equal cost."""

from __future__ import annotations

import json
from dataclasses import replace

import pytest
from slopewatch.lab.making.scene_scores import SceneScores
from slopewatch.models.configuration import SMOKE
from slopewatch.models.network.shipped import SHIPPED_WEIGHTS, shipped_model
from slopewatch.models.network.weights import load_model, save_model

TRAINING = {
    "scenes": 3,
    "points": 12_345,
    "steps": 17,
    "batch": 4,
    "processor_seconds_preparing": 60,
    "processor_seconds_training": 180,
    "torch": "2.13.0",
    "seed": 0,
}
CALIBRATION = {"temperature": 1.234, "points": 500}


@pytest.fixture
def description(torch, tmp_path):
    from slopewatch.models.network.randlanet import RandLANet

    path = tmp_path / "w.safetensors"
    save_model(path, RandLANet(SMOKE), TRAINING, {"calibration": CALIBRATION})
    return load_model(path).metadata


def test_the_shipped_card_is_that_of_the_shipped_scores(torch):
    from slopewatch.lab.making.model_card import model_card, read_figures
    from slopewatch.models.network.shipped import shipped_relief
    from slopewatch.models.network.unet import load_unet

    figures = SHIPPED_WEIGHTS.parent / "figures"
    seconds = json.loads((figures / "seconds.json").read_text(encoding="utf-8"))
    relief = load_unet(*shipped_relief())[1]
    text = model_card(load_model(*shipped_model()).metadata, read_figures(figures), seconds, relief)
    assert text == (figures.parent / "README.md").read_text(encoding="utf-8")


def test_a_card_without_scores_still_says_what_the_weights_are(description):
    from slopewatch.lab.making.model_card import model_card

    text = model_card(description, {}, {})
    for expected in (description["sha256"], "12,345 voxels", "1.234", "1 + 3 minutes", "must not be used"):
        assert expected in text
    assert "points thinned evenly from level to level |" in text
    description["configuration"].update(sampling="random", thinnings=3)
    again = model_card(description, {}, {})
    assert "points thinned at random from level to level, 3 looks at each window |" in again
    del description["configuration"]["sampling"]
    assert "thinned at random" in model_card(description, {}, {})
    assert "| groups |" not in again
    description["configuration"]["least_peak"] = 0.75
    assert "none of which is a hazard by 75.0 % are background before |" in model_card(description, {}, {})
    assert "five folds" not in text
    assert "weights on the benchmark sets" not in text


def test_a_card_with_the_network_on_relief_has_its_figures(description):
    from slopewatch.lab.making.model_card import model_card

    relief = {
        "parameters": 4321,
        "sha256": "ab" * 32,
        "configuration": {"cell": 0.5, "channels": ["a", "b"]},
        "training": {"steps": 1200, "simulated_slopes": 7, "real_ground": ["hill", "ravine"]},
        "calibration": {"scale": 1.25, "shift": -2.5},
        "metrics": {
            "date": "2026-01-02",
            "seeds": 3,
            "hazard_share": 0.03,
            "found": {"0.5": [0.61, 0.4, 0.1, 0.7, 0.6, 0.5]},
            "false_zones": {"hill": 0.94, "ravine": 1.06},
        },
    }
    text = model_card(description, {}, {}, relief)
    assert "| 0.5 m | 61 | 40 | 10 | 70 | 60 | 50 |" in text
    for expected in ("4,321", "ab" * 32, "hill, ravine", "hill 0.9, ravine 1.1", "scale 1.25, shift -2.50", "3.0 %"):
        assert expected in text
    assert "## The network on points" in text
    assert "## The network on" not in model_card(description, {}, {})


def test_the_scores_of_a_scene_are_told(description, small_scene, tmp_path):
    import numpy as np
    from slopewatch.lab.making.model_card import model_card, read_figures, read_seconds

    scores = SceneScores()
    scores.add(small_scene, np.eye(3, dtype=np.float32)[small_scene.label])
    for name in ("realistic_slopewatch", "realistic_residual"):
        (tmp_path / f"{name}.json").write_text(json.dumps(scores.summary()))
    fold = tmp_path / "folds" / "fold_0"
    fold.mkdir(parents=True)
    (fold / "seconds.csv").write_text("preparing_s,training_s,scoring_s\n1.0,120.0,30.0\n")
    mean = {"mean": 0.625, "lowest": 0.6, "highest": 0.65}
    folds = {"overall_accuracy": mean, "mean_iou": mean, "iou": {"background": 0.7, "uplift": 0.6, "subsidence": 0.5}}
    (tmp_path / "folds_slopewatch.json").write_text(json.dumps(folds))
    text = model_card(description, read_figures(tmp_path), {"slopewatch": read_seconds(tmp_path / "folds")})
    row = next(line for line in text.splitlines() if line.startswith("| realistic | shipped |"))
    assert row.split(" | ")[3] == "100.0"
    fold_row = next(line for line in text.splitlines() if line.startswith("| SlopeWatch |"))
    assert "62.5 (60.0 to 65.0)" in fold_row
    assert "2.0 min" in fold_row
    # Every table has as many cells in each row as in its head.
    widths = [line.count("|") for line in text.splitlines() if line.startswith("|")]
    groups = [g.splitlines() for g in text.split("\n\n") if g.startswith("|")]
    assert widths
    assert all(len({line.count("|") for line in group}) == 1 for group in groups)


def test_variants_take_about_the_same_time(torch, tmp_path, monkeypatch):
    from slopewatch.lab.making import ablation
    from slopewatch.models.training import recipes
    from slopewatch.models.training.training import TrainingParameters

    monkeypatch.setattr(ablation, "AREA", 200.0)
    recipe = recipes.Recipe(replace(SMOKE, trends=((4.0, 4.0),)), TrainingParameters(batch=1), step=20.0)
    wide = replace(recipe, configuration=replace(recipe.configuration, widths=(32, 64, 64)))

    # A clock by which a step takes a second, and three of the wide network's.
    clock = [0.0]
    original = recipes.train

    def timed(configuration, provider, frequencies, parameters, place, **named):
        clock[0] += parameters.steps * (3.0 if configuration.widths[0] == 32 else 1.0)
        return original(configuration, provider, frequencies, parameters, place, **named)

    monkeypatch.setattr(recipes, "train", timed)
    monkeypatch.setattr(ablation.time, "process_time", lambda: clock[0])
    variants = (ablation.Variant("small", recipe), ablation.Variant("wide", wide))
    found = ablation.ablate(tmp_path, 36.0, variants, scenes=2, held_out=1)
    assert [(row["variant"], row["steps"], row["training_s"]) for row in found] == [("small", 36, 36), ("wide", 12, 36)]
    assert all(0 < row["mean_iou"] < 1 for row in found)
