"""The shipped model: trained on simulated slopes from nothing, calibrated, scored on the benchmark sets."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from ..engine.progress import Progress
from ..simulation.hazard_scenes.scenes import build_scene
from ..simulation.hazard_scenes.sets import FIRST_TRAINING_SEED, SETS
from ..simulation.hazard_scenes.styles import SceneSpec, draw_spec
from .baseline import residual_probabilities
from .benchmark_folds import score_scenes
from .calibration import Calibration, apply_temperature, fit_temperature
from .network import RandLANet
from .prediction import predict
from .preparation import Block
from .recipes import Recipe
from .rougher import rolling, rougher

TRAINING_SCENES = 600
ROLLING_SCENES, FIRST_ROLLING = 120, 7000
HELD_OUT_SCENES = 24
FIRST_HELD_OUT = 900_000
"""Scenes for the temperature have training seeds that training does not reach."""
SCENE_AREA = (1500.0, 3500.0)
DENSITY = (8.0, 250.0)
BALANCED_SHARE = 0.1
"""Share of training scenes whose hazards cover about half of them; on the others they are as rare as on real slopes."""
SAMPLE = 40_000


def training_scenes(count: int, first: int = 0) -> Iterator[SceneSpec]:
    """Specifications that no benchmark set holds: small, of all densities that UAVs fly, of both kinds."""
    for k in range(first, first + count):
        rng = np.random.default_rng([FIRST_TRAINING_SEED, k])
        kind = "published" if rng.random() < BALANCED_SHARE else "realistic"
        density = math.exp(rng.uniform(math.log(DENSITY[0]), math.log(DENSITY[1])))
        yield draw_spec(FIRST_TRAINING_SEED + k, kind, area=float(rng.uniform(*SCENE_AREA)), density=density)


def train_shipped(
    recipe: Recipe,
    folder: Path,
    *,
    scenes: int = TRAINING_SCENES,
    rolling_ground: bool = False,
    start: RandLANet | None = None,
    device: torch.device | None = None,
    seconds: float = math.inf,
    progress: Progress | None = None,
) -> tuple[RandLANet, dict[str, Any]] | None:
    """Train from nothing or from ``start``, or go on from the checkpoint in ``folder``.

    Args:
        rolling_ground: train on other scenes, half of which roll as natural ground does.

    Returns:
        The network and facts about its training; None where ``seconds`` did not suffice: run again to go on.
    """
    device, progress = device or torch.device("cpu"), progress or Progress()
    begun = time.process_time()
    blocks: list[Block] = []
    with progress.stage(0.0, 0.3, "simulating and preparing scenes"):
        for number, spec in enumerate(training_scenes(scenes, FIRST_ROLLING if rolling_ground else 0)):
            if rolling_ground:
                scene = rolling(build_scene(spec), np.random.default_rng([number, 5]))
            else:
                scene = rougher(build_scene(spec), np.random.default_rng([spec.seed, 3]))
            blocks += recipe.blocks(scene)
            progress.update((number + 1) / scenes, f"scene {number + 1} of {scenes}")
    prepared = time.process_time()
    with progress.stage(0.3, 1.0, "training"):
        state = recipe.train(blocks, folder, device=device, start=start, seconds=seconds, progress=progress)
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
        "processor_seconds_preparing": round(prepared - begun),
        "processor_seconds_training": round(time.process_time() - prepared),
    }
    return state.network.cpu(), facts


def both(first: dict[str, Any], second: dict[str, Any]) -> dict[str, Any]:
    """Facts of two trainings, one after the other, added up."""
    added = ("scenes", "blocks", "points", "steps", "processor_seconds_preparing", "processor_seconds_training")
    return {**first, **{name: first[name] + second[name] for name in added}, "of_these_on_rolling_ground": second}


def joined_logs(first: Path, second: Path) -> str:
    """The rows of two trainings' logs; steps of the second are counted on from the first's."""
    head, *rows = first.read_text(encoding="utf-8").split()
    done = int(rows[-1].split(",")[0])
    for row in second.read_text(encoding="utf-8").split()[1:]:
        step, rest = row.split(",", 1)
        rows.append(f"{done + int(step)},{rest}")
    return "\n".join([head, *rows]) + "\n"


def calibrate(network: RandLANet, progress: Progress | None = None) -> Calibration:
    """The temperature on realistic scenes that training did not see."""
    progress = progress or Progress()
    probabilities: list[NDArray[np.float32]] = []
    labels: list[NDArray[np.uint8]] = []
    for number, spec in enumerate(training_scenes(4 * HELD_OUT_SCENES, FIRST_HELD_OUT)):
        if spec.kind != "realistic" or len(labels) >= HELD_OUT_SCENES:
            continue
        scene = build_scene(spec)
        found = predict(network, scene.xyz).probabilities
        few = np.random.default_rng([spec.seed, 2]).permutation(len(scene))[:SAMPLE]
        probabilities.append(found[few])
        labels.append(scene.label[few])
        progress.update(min(1.0, len(labels) / HELD_OUT_SCENES), f"scene {number + 1}")
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
