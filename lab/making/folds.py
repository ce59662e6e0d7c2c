"""The benchmark of the published set: five folds by scene, every point of every scene scored by a model that never saw
its scene.
"""

from __future__ import annotations

import csv
import time
from collections.abc import Callable, Iterator, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import torch

from ...engine.core.progress import Progress
from ...models.inference.baseline import residual_probabilities
from ...models.inference.prediction import predict
from ...models.network.weights import save_model
from ...models.preparation.prepare import Block
from ...models.training.cross_validation import Fold, cross_validate, folds
from ...models.training.recipes import Recipe
from ...simulation.hazard_scenes.scenes import build_scene
from ...simulation.hazard_scenes.styles import SIMULATOR_VERSION, SceneSpec
from .scene_blocks import scene_blocks
from .scene_scores import SceneScores

WEIGHTS_NAME = "network.safetensors"
"""The weights of a fold, in its folder."""


def score_folds(
    specs: Sequence[SceneSpec],
    recipe: Recipe,
    folder: Path,
    *,
    count: int = 5,
    only: Sequence[int] = (),
    device: torch.device | None = None,
    progress: Progress | None = None,
) -> dict[str, Any]:
    """Train and score fold by fold; goes on from what is in ``folder``.

    Args:
        specs: the scenes; each is simulated when it is needed, which takes less than reading it would.
        only: numbers of the folds to do now, so that several processes can share them; all by default.

    Returns:
        The summary of ``cross_validation.cross_validate`` over the folds done. A fold's folder has its weights,
        ``network.safetensors``, and in ``seconds.csv`` the processor's seconds that it took.
    """
    device, progress = device or torch.device("cpu"), progress or Progress()
    chosen = folds(len(specs), count)
    chosen = [chosen[number] for number in only] if only else chosen
    prepared: dict[int, list[Block]] = {}

    def blocks_of(numbers: Sequence[int]) -> list[Block]:
        for done, number in enumerate(numbers):
            if number not in prepared:
                prepared[number] = scene_blocks(recipe, build_scene(specs[number]))
            progress.update((done + 1) / len(numbers), f"preparing scene {done + 1} of {len(numbers)}")
        return [block for number in numbers for block in prepared[number]]

    def one(fold: Fold, place: Path) -> SceneScores:
        low, part = chosen.index(fold) / len(chosen), 1.0 / len(chosen)
        times = [time.process_time()]
        with progress.stage(low, low + 0.2 * part, f"fold {fold.number + 1}: preparing"):
            blocks = blocks_of(fold.train)
        times.append(time.process_time())
        with progress.stage(low + 0.2 * part, low + 0.7 * part, f"fold {fold.number + 1}: training"):
            state = recipe.train(blocks, place, device=device, progress=progress)
        times.append(time.process_time())
        facts = {"steps": state.step, "scenes": [specs[k].seed for k in fold.train], "blocks": len(blocks)}
        save_model(place / WEIGHTS_NAME, state.network, facts, {}, simulator_version=SIMULATOR_VERSION)
        with progress.stage(low + 0.7 * part, low + part, f"fold {fold.number + 1}: scoring"):
            scores = score_scenes(
                (specs[k] for k in fold.test),
                lambda xyz: predict(state.network, xyz, device=device).probabilities,
                len(fold.test),
                progress,
            )
        times.append(time.process_time())
        _write_seconds(place / "seconds.csv", *(b - a for a, b in pairwise(times)))
        return scores

    return cross_validate(chosen, folder, one)


def score_residual(
    specs: Sequence[SceneSpec], folder: Path, *, count: int = 5, progress: Progress | None = None
) -> dict[str, Any]:
    """The same scores of the threshold on the height over the trend, which learns nothing."""
    progress = progress or Progress()

    def one(fold: Fold, place: Path) -> SceneScores:
        with progress.stage(fold.number / count, (fold.number + 1) / count, f"fold {fold.number + 1}"):
            return score_scenes((specs[k] for k in fold.test), residual_probabilities, len(fold.test), progress)

    return cross_validate(folds(len(specs), count), folder, one)


def score_scenes(
    specs: Iterator[SceneSpec], screen: Callable[..., Any], count: int, progress: Progress | None = None
) -> SceneScores:
    """Scores of ``screen`` (points (n, 3) to probabilities (n, 3)) over scenes."""
    progress, scores = progress or Progress(), SceneScores()
    for number, spec in enumerate(specs):
        scene = build_scene(spec)
        scores.add(scene, screen(scene.xyz))
        progress.update((number + 1) / max(count, number + 1), f"scored {number + 1} of {count} scenes")
    return scores


def _write_seconds(path: Path, preparation: float, training: float, scoring: float) -> None:
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(["preparing_s", "training_s", "scoring_s"])
        writer.writerow([f"{x:.1f}" for x in (preparation, training, scoring)])
