"""The shipped model: trained on simulated slopes from nothing, calibrated, scored on the benchmark sets."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from ...engine.core.progress import Progress
from ...models.inference.baseline import residual_probabilities
from ...models.inference.calibration import Calibration, apply_temperature, fit_temperature
from ...models.inference.prediction import predict
from ...models.network.randlanet import RandLANet
from ...models.preparation.prepare import Block
from ...models.training.recipes import Recipe
from ...simulation.hazard_scenes.scenes import build_scene
from ...simulation.hazard_scenes.sets import FIRST_TRAINING_SEED, SETS
from ...simulation.hazard_scenes.styles import SceneSpec, draw_spec, log_uniform
from .folds import score_scenes
from .rough_ground import natural
from .scene_blocks import in_order, scene_blocks

TRAINING_SCENES = 1100
HELD_OUT_SCENES = 24
FIRST_HELD_OUT = 900_000
"""Scenes for the temperature have training seeds that training does not reach."""
SCENE_AREA = (1500.0, 3500.0)
DENSITY = (8.0, 250.0)
BALANCED_SHARE, DENSE_SHARE, DENSE = 0.15, 0.4, 4.0
"""Shares of the training scenes whose hazards cover about half of them, and ``DENSE`` times as much as on real slopes:
more to learn from in the same area. On the others hazards are as rare as there.
"""
SAMPLE = 40_000


def training_scenes(
    count: int, first: int = 0, *, balanced: float = BALANCED_SHARE, dense: float = DENSE_SHARE
) -> Iterator[SceneSpec]:
    """Specifications that no benchmark set holds: small, of all densities that UAVs fly."""
    for k in range(first, first + count):
        rng = np.random.default_rng([FIRST_TRAINING_SEED, k])
        kind = "published" if (drawn := rng.random()) < balanced else "realistic"
        density = log_uniform(DENSITY, rng)
        spec = draw_spec(FIRST_TRAINING_SEED + k, kind, area=float(rng.uniform(*SCENE_AREA)), density=density)
        if balanced <= drawn < balanced + dense:
            spec = replace(spec, uplift=DENSE * spec.uplift, subsidence=DENSE * spec.subsidence)
        yield spec


def train_shipped(
    recipe: Recipe,
    folder: Path,
    *,
    scenes: int = TRAINING_SCENES,
    processes: int = 1,
    device: torch.device | None = None,
    seconds: float = math.inf,
    progress: Progress | None = None,
) -> tuple[RandLANet, dict[str, Any]] | None:
    """Train from nothing, or go on from the checkpoint in ``folder``.

    Args:
        processes: that simulate and prepare scenes at once; the blocks are the same for any number.

    Returns:
        The network and facts about its training; None where ``seconds`` did not suffice: run again to go on.
    """
    device, progress = device or torch.device("cpu"), progress or Progress()
    blocks: list[Block] = []
    preparing = 0.0
    with progress.stage(0.0, 0.2, "simulating and preparing scenes"):
        specs = list(training_scenes(scenes))
        for number, (more, took) in enumerate(in_order(partial(_natural_blocks, recipe), specs, processes)):
            blocks += more
            preparing += took
            progress.update((number + 1) / scenes, f"scene {number + 1} of {scenes}")
    prepared = time.process_time()
    with progress.stage(0.2, 1.0, "training"):
        state = recipe.train(blocks, folder, device=device, seconds=seconds, progress=progress)
    if not state.finished:
        return None
    facts = {
        "scenes": scenes,
        "blocks": len(blocks),
        "points": sum(len(block) for block in blocks),
        "steps": recipe.training.steps,
        "batch": recipe.training.batch,
        "seed": recipe.training.seed,
        "device": device.type,
        "torch": torch.__version__,
        "processor_seconds_preparing": round(preparing),
        "processor_seconds_training": round(time.process_time() - prepared),
    }
    return state.network.cpu(), facts


def _natural_blocks(recipe: Recipe, spec: SceneSpec) -> tuple[list[Block], float]:
    """The blocks of a scene on natural ground, and the processor's seconds that they took."""
    begun = time.process_time()
    blocks = scene_blocks(recipe, natural(build_scene(spec), np.random.default_rng([spec.seed, 3])))
    return blocks, time.process_time() - begun


def calibrate(network: RandLANet, progress: Progress | None = None) -> Calibration:
    """The temperature on realistic scenes that training did not see."""
    progress = progress or Progress()
    probabilities: list[NDArray[np.float32]] = []
    labels: list[NDArray[np.uint8]] = []
    for number, spec in enumerate(training_scenes(HELD_OUT_SCENES, FIRST_HELD_OUT, balanced=0.0, dense=0.0)):
        scene = build_scene(spec)
        found = predict(network, scene.xyz).probabilities
        few = np.random.default_rng([spec.seed, 2]).permutation(len(scene))[:SAMPLE]
        probabilities.append(found[few])
        labels.append(scene.label[few])
        progress.update((number + 1) / HELD_OUT_SCENES, f"scene {number + 1} of {HELD_OUT_SCENES}")
    return fit_temperature(np.concatenate(probabilities), np.concatenate(labels))


def score_set(
    name: str,
    network: RandLANet | None,
    temperature: float,
    *,
    device: torch.device | None = None,
    progress: Progress | None = None,
) -> dict[str, Any]:
    """Scores of the network, or without one of the threshold on the residual, on the benchmark set ``name``."""

    def screen(xyz: NDArray[np.float64]) -> NDArray[np.floating]:
        if network is None:
            return residual_probabilities(xyz)
        return apply_temperature(predict(network, xyz, device=device).probabilities, temperature)

    chosen = SETS[name]()
    return score_scenes(iter(chosen.specs), screen, len(chosen), progress).summary()
