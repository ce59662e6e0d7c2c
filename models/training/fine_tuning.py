"""Fine-tuning on labelled clouds: scored by folds that hold every cloud out once, then trained on all of them."""

from __future__ import annotations

import csv
import hashlib
import json
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from ...engine.core import cancellation
from ...engine.core.errors import InputError
from ...engine.core.progress import Progress
from ...engine.core.staged_outputs import atomic_output
from ...interface.parameters import FineTuneParameters, given
from ..configuration import CLASSES, SMOKE, ModelConfiguration
from ..inference.calibration import Calibration, fit_temperature
from ..inference.prediction import predict
from ..network.randlanet import RandLANet
from ..network.weights import ModelFile
from ..preparation.prepare import Block
from .cross_validation import Fold, cross_validate, folds
from .dataset import labelled_blocks
from .evaluation import LabelScores, confusion, label_figures
from .own_data import OwnCloud
from .recipes import PUBLISHED, SHIPPED
from .training import TrainingParameters, block_provider, class_frequencies, train

HELD_OUT = 100_000
"""Points of a held-out cloud that its probabilities are kept of, for the calibration."""
SAVE_EVERY = 20.0
FROM_WEIGHTS, FROM_NOTHING = 0.002, 0.01
"""Learning rates where none is given."""
_TIMED_STEPS = 4
_MAX_TIME_SHARE = 0.85


@dataclass
class TunedScores(LabelScores):
    """Scores of held-out clouds; ``start`` is the confusion of the weights that training started from, on the same
    points.
    """

    start: NDArray[np.int64] | None = None

    def summary(self) -> dict[str, Any]:
        """As ``TunedScores.summary``, with ``start_confusion``."""
        return {**super().summary(), "start_confusion": None if self.start is None else self.start.tolist()}


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


def tuned_configuration(
    start: ModelFile | None, parameters: FineTuneParameters, clouds: Sequence[OwnCloud]
) -> ModelConfiguration:
    """The configuration of a model that starts from these weights, or from nothing, and knows these clouds' density."""
    base = start.configuration if start else SMOKE if parameters.network == "smoke" else SHIPPED.configuration
    density = [cloud.density for cloud in clouds]
    known = base.density if start else (density[0], density[0])
    bounds = min(known[0], 0.8 * min(density)), max(known[1], 1.25 * max(density))
    return replace(base, name=f"{base.name}, own data", density=(round(bounds[0], 1), round(bounds[1], 1)))


def chosen_folds(clouds: int, parameters: FineTuneParameters) -> tuple[Fold, ...]:
    """The folds over so many clouds: one cloud each where there are fewer than folds; none where there is one cloud."""
    if clouds < 2:
        return ()
    return tuple(folds(clouds, min(parameters.folds, clouds), parameters.seed))


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
    plan = _Plan(folder, _identity(clouds, start, parameters, configuration))
    with progress.stage(0.0, 0.08, "preparing the clouds"):
        blocks = _prepared(clouds, configuration, parameters.seed, progress)
    run = _Run(clouds, blocks, start, configuration, parameters, chosen, folder, device, progress)
    run.steps = plan.steps(lambda: run.fitting_steps() if parameters.minutes else parameters.steps)
    scores = calibration = None
    if chosen:
        cross_validate(chosen, folder, run.train_and_score)
        scores = pooled_scores(json.loads((folder / "folds.json").read_text(encoding="utf-8"))["folds"])
        calibration = fit_temperature(*_held_out(folder, chosen))
    low = run.share(len(chosen))
    with progress.stage(low, 1.0, "training on all files"):
        network = run.train(range(len(clouds)), folder / "all")
    return FineTuned(network, chosen, scores, calibration, run.steps)


@dataclass
class _Run:
    """One fine-tuning under way."""

    clouds: Sequence[OwnCloud]
    blocks: list[list[Block]]
    start: ModelFile | None
    configuration: ModelConfiguration
    parameters: FineTuneParameters
    chosen: tuple[Fold, ...]
    folder: Path
    device: torch.device
    progress: Progress
    steps: int = 0

    def share(self, number: int) -> float:
        """Share of the whole work that is done before training ``number``."""
        return 0.08 + 0.92 * number / (len(self.chosen) + 1)

    def settings(self, steps: int) -> TrainingParameters:
        rate = given(self.parameters.learning_rate) or (FROM_WEIGHTS if self.start else FROM_NOTHING)
        recipe = SHIPPED if self.configuration.align else PUBLISHED
        return replace(
            recipe.training,
            steps=steps,
            batch=self.parameters.batch,
            learning_rate=rate,
            seed=self.parameters.seed,
        )

    def train(self, chosen: Sequence[int], place: Path, steps: int = 0) -> RandLANet:
        """A network trained on the clouds of these numbers, in evaluation mode."""
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

    def train_and_score(self, fold: Fold, place: Path) -> TunedScores:
        """Train on a fold's clouds, score the others and keep some of their probabilities for the calibration."""
        low, high = self.share(fold.number), self.share(fold.number + 1)
        title = f"fold {fold.number + 1} of {len(self.chosen)}"
        with self.progress.stage(low, low + 0.8 * (high - low), title):
            network = self.train(fold.train, place)
        scores = TunedScores(start=np.zeros((len(CLASSES),) * 2, dtype=np.int64) if self.start else None)
        kept: list[tuple[NDArray[np.floating], NDArray[np.uint8]]] = []
        with self.progress.stage(low + 0.8 * (high - low), high, f"scoring {title}"):
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

    def _predict(self, network: RandLANet, cloud: OwnCloud) -> NDArray[np.float32]:
        return predict(network, cloud.xyz, device=self.device, seed=self.parameters.seed).probabilities

    def fitting_steps(self) -> int:
        """Steps of each training with which all of them take about the minutes asked for, from a few that are timed."""
        place = self.folder / "timing"
        with cancellation.temporary(place):
            # The first step pays for warming up, and a training's start and end cost the same however long it is.
            self.train(range(len(self.clouds)), place / "first", steps=1)
            begun = time.monotonic()
            network = self.train(range(len(self.clouds)), place / "more", steps=_TIMED_STEPS)
            each = (time.monotonic() - begun) / _TIMED_STEPS
            smallest = min(self.clouds, key=lambda cloud: len(cloud.xyz))
            begun = time.monotonic()
            if self.chosen:
                self._predict(network, smallest)
            scored = time.monotonic() - begun
        points = sum(len(cloud.xyz) for cloud in self.clouds)
        scoring = scored * points / len(smallest.xyz) * (2 if self.start else 1)
        left = _MAX_TIME_SHARE * 60.0 * self.parameters.minutes - scoring
        steps = max(_TIMED_STEPS, int(left / (each * (len(self.chosen) + 1))))
        if steps < 50:
            self.progress.warning(
                f"Only {steps} steps a training fit into {self.parameters.minutes:g} minutes; give more minutes or "
                "fewer folds."
            )
        return steps


class _Plan:
    """What a training folder is for, so that it is not gone on with by another training; and the steps once chosen."""

    def __init__(self, folder: Path, identity: dict[str, Any]) -> None:
        self.path = folder / "plan.json"
        self.identity = json.loads(json.dumps(identity))
        self.found: int | None = None
        if self.path.is_file():
            try:
                plan = json.loads(self.path.read_text(encoding="utf-8"))
                same, self.found = plan["identity"] == self.identity, int(plan["steps"])
            except (ValueError, KeyError, TypeError, OSError) as error:
                raise InputError(f"{self.path} cannot be read ({error}); remove the folder {folder}.") from error
            if not same:
                raise InputError(
                    f"The folder {folder} holds a training on other data or with other settings; choose another output "
                    "folder or remove it."
                )

    def steps(self, choose: Callable[[], int]) -> int:
        """The steps of each training: as found, else chosen now and kept."""
        if self.found is None:
            self.found = choose()
            self.path.parent.mkdir(parents=True, exist_ok=True)
            with atomic_output(self.path) as partial:
                partial.write_text(
                    json.dumps({"steps": self.found, "identity": self.identity}, indent=2), encoding="utf-8"
                )
        return self.found


def _identity(
    clouds: Sequence[OwnCloud],
    start: ModelFile | None,
    parameters: FineTuneParameters,
    configuration: ModelConfiguration,
) -> dict[str, Any]:
    values = asdict(parameters)
    for name in ("device", "threads", "start"):
        values.pop(name)
    return {
        "clouds": [[cloud.sha256, cloud.labels_sha256] for cloud in clouds],
        "coordinates": [hashlib.sha256(cloud.xyz[:1000].tobytes()).hexdigest() for cloud in clouds],
        "start": start.sha256 if start else None,
        "parameters": values,
        "configuration": asdict(configuration),
    }


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


def _held_out(folder: Path, chosen: Sequence[Fold]) -> tuple[NDArray[np.floating], NDArray[np.uint8]]:
    parts = []
    for fold in chosen:
        with np.load(folder / f"fold_{fold.number}" / "held_out.npz", allow_pickle=False) as file:
            parts.append((file["probabilities"], file["labels"]))
    return np.concatenate([p for p, _ in parts]), np.concatenate([labels for _, labels in parts])


def pooled_scores(results: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """Scores over all held-out points, from those of the folds (``TunedScores.summary``), each point counted once.

    ``majority_accuracy`` is what naming the most frequent class everywhere would reach; ``start_*`` what the weights
    reach that training started from.
    """
    counts = np.sum([result["confusion"] for result in results], axis=0)
    pooled = {**label_figures(counts), "majority_accuracy": round(float(counts.sum(axis=1).max() / counts.sum()), 4)}
    if all(result["start_confusion"] is not None for result in results):
        before = np.sum([result["start_confusion"] for result in results], axis=0)
        pooled |= {f"start_{name}": value for name, value in label_figures(before).items()}
    pooled["folds"] = [{name: r[name] for name in ("test", "overall_accuracy", "mean_iou", "iou")} for r in results]
    return pooled


def collect_log(folder: Path, chosen: Sequence[Fold], path: Path) -> None:
    """Write the logs of all trainings in ``folder`` as one CSV file, with the column ``training`` in front."""
    with atomic_output(path) as partial, partial.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(["training", "step", "loss", "learning_rate", "seconds"])
        for name in [*(f"fold_{fold.number}" for fold in chosen), "all"]:
            with (folder / name / "log.csv").open(newline="", encoding="utf-8") as log:
                rows = csv.reader(log)
                next(rows)
                writer.writerows([name, *row] for row in rows)
