"""Fine-tuning of the network on points on labelled clouds: scored by folds, then trained on all of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from ...engine.core.errors import InputError
from ...engine.core.progress import Progress
from ...engine.core.staged_outputs import atomic_output
from ...interface.parameters import FineTuneParameters, given
from ..configuration import CLASSES, SMOKE, ModelConfiguration
from ..inference.calibration import Calibration, fit_temperature
from ..inference.prediction import predict
from ..network.randlanet import RandLANet
from ..network.weights import ModelFile, save_model
from ..preparation.prepare import Block
from .cross_validation import Fold
from .dataset import labelled_blocks
from .evaluation import confusion
from .own_data import OwnCloud
from .recipes import PUBLISHED, SHIPPED
from .training import TrainingParameters, block_provider, class_frequencies, train
from .tuning import HELD_OUT, Plan, TunedScores, Tuning, chosen_folds, identity, pooled_scores

SAVE_EVERY = 20.0
FROM_WEIGHTS, FROM_NOTHING = 0.002, 0.01
"""Learning rates where none is given."""
WINDOWS = 2
"""In a step, where their number is not given."""


@dataclass(frozen=True)
class FineTuned:
    """A network trained on all clouds, how it was scored (None where one cloud left nothing to score on) and fitted,
    and the steps of each training.
    """

    network: RandLANet
    folds: tuple[Fold, ...]
    scores: dict[str, Any] | None
    calibration: Calibration | None
    steps: int
    simulator_version: int | None

    def save(self, path: Path, facts: dict[str, Any], metrics: dict[str, Any]) -> str:
        """Write weights and description, as ``weights.save_model``; the weights' SHA-256."""
        return save_model(path, self.network, facts, metrics, simulator_version=self.simulator_version)

    def figures(self) -> dict[str, Any]:
        """What the run record says beyond the scores."""
        return {"temperature": self.calibration.temperature if self.calibration else None}


def tuned_configuration(
    start: ModelFile | None, parameters: FineTuneParameters, clouds: Sequence[OwnCloud]
) -> ModelConfiguration:
    """The configuration of a model that starts from these weights, or from nothing, and knows these clouds' density."""
    base = start.configuration if start else SMOKE if parameters.network == "smoke" else SHIPPED.configuration
    density = [cloud.density for cloud in clouds]
    known = base.density if start else (density[0], density[0])
    bounds = min(known[0], 0.8 * min(density)), max(known[1], 1.25 * max(density))
    return replace(base, name=f"{base.name}, own data", density=(round(bounds[0], 1), round(bounds[1], 1)))


def fine_tune(
    clouds: Sequence[OwnCloud],
    start: ModelFile | None,
    parameters: FineTuneParameters,
    folder: Path,
    *,
    device: torch.device | None = None,
    progress: Progress | None = None,
) -> FineTuned:
    """Score by folds, calibrate, and train on all clouds; goes on from what is in ``folder``.

    Args:
        clouds: labelled, not the same twice.
        start: weights to start from; a fresh network without.
        folder: for checkpoints, logs and the folds' scores; made if need be.

    Raises:
        InputError: ``folder`` is of another training; a cloud cannot be prepared.
    """
    device, progress = device or torch.device("cpu"), progress or Progress()
    configuration = tuned_configuration(start, parameters, clouds)
    chosen = chosen_folds(len(clouds), parameters)
    plan = Plan(folder, identity(clouds, start.sha256 if start else None, parameters, asdict(configuration)))
    with progress.stage(0.0, Tuning.prepared, "preparing the clouds"):
        blocks = _prepared(clouds, configuration, parameters.seed, progress)
    run = _PointsTuning(
        clouds,
        parameters,
        chosen,
        folder,
        progress,
        blocks=blocks,
        start=start,
        configuration=configuration,
        device=device,
    )
    network = run.run(plan)
    version = start.metadata.get("simulator_version") if start else None
    if not chosen:
        return FineTuned(network, chosen, None, None, run.steps, version)
    calibration = fit_temperature(*run.held_out("probabilities", "labels"))
    return FineTuned(network, chosen, pooled_scores(run.fold_scores()), calibration, run.steps, version)


@dataclass(kw_only=True)
class _PointsTuning(Tuning[RandLANet]):
    blocks: list[list[Block]]
    start: ModelFile | None
    configuration: ModelConfiguration
    device: torch.device

    @property
    def scored_twice(self) -> bool:
        return self.start is not None

    def settings(self, steps: int) -> TrainingParameters:
        rate = given(self.parameters.learning_rate) or (FROM_WEIGHTS if self.start else FROM_NOTHING)
        recipe = SHIPPED if self.configuration.align else PUBLISHED
        return replace(
            recipe.training,
            steps=steps,
            batch=int(given(self.parameters.batch) or WINDOWS),
            learning_rate=rate,
            seed=self.parameters.seed,
        )

    def train(self, chosen: Sequence[int], place: Path, steps: int = 0) -> RandLANet:
        mine = [block for number in chosen for block in self.blocks[number]]
        settings = self.settings(steps or self.steps)
        state = train(
            self.configuration,
            block_provider(mine, settings, self.device),
            class_frequencies(mine, len(CLASSES)),
            settings,
            place,
            device=self.device,
            start=self.start.network if self.start else None,
            save_every=SAVE_EVERY,
            progress=self.progress,
        )
        return state.network

    def score(self, network: RandLANet, fold: Fold, place: Path) -> TunedScores:
        scores = TunedScores(start=np.zeros((len(CLASSES),) * 2, dtype=np.int64) if self.start else None)
        kept: list[tuple[NDArray[np.floating], NDArray[np.uint8]]] = []
        for place_in_fold, number in enumerate(fold.test):
            cloud = self.clouds[number]
            labels, known = cloud.labels[cloud.known], cloud.known
            self.progress.update(place_in_fold / len(fold.test), f"scoring {cloud.name}")
            found = self._predict(network, cloud)[known]
            scores.add_points(labels, found)
            if self.start and scores.start is not None:
                before = self._predict(self.start.network.to(self.device), cloud)[known]
                scores.start += confusion(labels, before.argmax(axis=1).astype(np.uint8))
            rng = np.random.default_rng([self.parameters.seed, number])
            some = rng.permutation(len(labels))[:HELD_OUT]
            kept.append((found[some], labels[some]))
        with atomic_output(place / "held_out.npz") as partial:
            np.savez(
                partial, probabilities=np.concatenate([p for p, _ in kept]), labels=np.concatenate([n for _, n in kept])
            )
        return scores

    def look(self, network: RandLANet, cloud: OwnCloud, place: Path) -> None:
        self._predict(network, cloud)

    def _predict(self, network: RandLANet, cloud: OwnCloud) -> NDArray[np.float32]:
        return predict(network, cloud.xyz, device=self.device, seed=self.parameters.seed).probabilities


def _prepared(
    clouds: Sequence[OwnCloud], configuration: ModelConfiguration, seed: int, progress: Progress
) -> list[list[Block]]:
    prepared = []
    for number, cloud in enumerate(clouds):
        progress.update(number / len(clouds), f"preparing {cloud.name}")
        try:
            blocks = labelled_blocks(cloud.xyz, cloud.labels, configuration, seed=seed)
        except InputError as error:
            raise InputError(f"{cloud.name} cannot be trained on: {error}") from error
        if not blocks:
            raise InputError(f"{cloud.name} fills no window of {configuration.window:g} m; leave it out.")
        prepared.append(blocks)
    return prepared
