"""What each choice of the model gives: the same scenes, the same time of a processor, one thing changed."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from ...engine.core.progress import Progress
from ...models.inference.prediction import predict
from ...models.network.batches import Augmentation
from ...models.network.randlanet import RandLANet
from ...models.training.recipes import HALF_WIDTH, PUBLISHED, SLOPEWATCH, Recipe
from ...simulation.hazard_scenes.scenes import build_scene
from ...simulation.hazard_scenes.sets import training_specs
from ...simulation.hazard_scenes.styles import SceneSpec
from .folds import score_scenes
from .scene_blocks import scene_blocks
from .scene_scores import SceneScores

SCENES, HELD_OUT = 48, 8
FIRST_HELD_OUT = 950_000
AREA = 2500.0
_TIMED_STEPS = 8
_THREE_TRENDS = ((1.5, 1.5), (4.0, 4.0), (10.0, 0.6))


@dataclass(frozen=True)
class Variant:
    """``name`` says what differs from the shipped recipe."""

    name: str
    recipe: Recipe


def _changed(**values: Any) -> Recipe:
    return replace(SLOPEWATCH, configuration=replace(SLOPEWATCH.configuration, **values))


def _trained(**values: Any) -> Recipe:
    return replace(SLOPEWATCH, training=replace(SLOPEWATCH.training, **values))


VARIANTS = (
    Variant("SlopeWatch's recipe", SLOPEWATCH),
    Variant("a point has its own voxel's class", _changed(interpolation=1)),
    Variant("points thinned at random, as published", _changed(sampling="random")),
    Variant("without Dice", _trained(dice=0.0)),
    Variant("turned to any side", _trained(augmentation=Augmentation(turn=180.0))),
    Variant("first block of half width", _changed(widths=HALF_WIDTH)),
    Variant("16 neighbours", _changed(neighbours=16)),
    Variant("three trends", _changed(trends=_THREE_TRENDS)),
    Variant("no heights over trends", _changed(features=("x", "y", "z"), trends=())),
    Variant("offsets not scaled by level", _changed(level_scaling=False)),
    Variant("heights scaled like x and y", _changed(z_scale=10.0)),
    Variant("voxels of 0.25 m", _changed(voxel=0.25)),
    Variant("published pipeline", PUBLISHED),
)


def ablate(
    folder: Path,
    seconds: float,
    variants: Sequence[Variant] = VARIANTS,
    *,
    scenes: int = SCENES,
    held_out: int = HELD_OUT,
    progress: Progress | None = None,
) -> list[dict[str, Any]]:
    """Train each variant for about ``seconds`` of the processor and score it on scenes that none was trained on.

    The steps follow from the time that the first few take. One seed: differences of about one point are chance.

    Returns:
        For each variant its name, steps, processor's seconds of training, accuracy, mean IoU, false zones a 1,000 m²
        and the share of hazards found.
    """
    progress, found = progress or Progress(), []
    train_on = tuple(training_specs("published", scenes, area=AREA))
    score_on = tuple(training_specs("published", held_out, first=FIRST_HELD_OUT, area=AREA))
    for number, variant in enumerate(variants):
        low, part = number / len(variants), 1 / len(variants)
        with progress.stage(low, low + part, variant.name):
            network, steps, used = _train(variant.recipe, train_on, seconds, folder / f"variant_{number}", progress)
            scores = score_scenes(iter(score_on), _screen(network), held_out)
        found.append({"variant": variant.name, "steps": steps, "training_s": round(used), **_kept(scores)})
    return found


def _screen(network: RandLANet) -> Callable[..., Any]:
    return lambda xyz: predict(network, xyz).probabilities


def _kept(scores: SceneScores) -> dict[str, Any]:
    whole = scores.summary()
    names = ("overall_accuracy", "mean_iou", "calibration_error", "false_zones_per_1000_m2")
    return {**{name: whole[name] for name in names}, "found": whole["recall_15_cm_2_m"]["recall"]}


def _train(
    recipe: Recipe, specs: Sequence[SceneSpec], seconds: float, folder: Path, progress: Progress
) -> tuple[RandLANet, int, float]:
    """The network, its steps and the processor's seconds that they took."""
    blocks = [block for spec in specs for block in scene_blocks(recipe, build_scene(spec))]

    def run(steps: int, place: Path) -> tuple[RandLANet, float]:
        begun = time.process_time()
        state = recipe.with_steps(steps).train(blocks, place, progress=progress)
        return state.network, time.process_time() - begun

    run(2, folder / "warm")
    _, timed = run(_TIMED_STEPS, folder / "timed")
    steps = max(_TIMED_STEPS, round(seconds * _TIMED_STEPS / timed))
    network, used = run(steps, folder / "whole")
    return network, steps, used
