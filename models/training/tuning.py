"""Fine-tuning whatever the network: folds that hold every cloud out once, then a training on all of them.

Stopped, it goes on where it was.
"""

from __future__ import annotations

import csv
import hashlib
import json
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, ClassVar, Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from ...engine.core import cancellation
from ...engine.core.errors import InputError
from ...engine.core.progress import Progress
from ...engine.core.staged_outputs import atomic_output
from ...interface.parameters import FineTuneParameters, given
from .cross_validation import Fold, cross_validate, folds
from .evaluation import LabelScores, label_figures
from .own_data import OwnCloud

HELD_OUT = 100_000
"""Points or cells of a held-out cloud that are kept for the calibration."""
_MAX_TIME_SHARE = 0.85
Network = TypeVar("Network")


@dataclass
class TunedScores(LabelScores):
    """Scores of held-out clouds; ``start`` is the confusion of the weights that training started from, on the same
    points.
    """

    start: NDArray[np.int64] | None = None

    def summary(self) -> dict[str, Any]:
        """As ``LabelScores.summary``, with ``start_confusion``."""
        return {**super().summary(), "start_confusion": None if self.start is None else self.start.tolist()}


def chosen_folds(clouds: int, parameters: FineTuneParameters) -> tuple[Fold, ...]:
    """The folds over so many clouds: one cloud each where there are fewer than folds; none where there is one cloud."""
    if clouds < 2:
        return ()
    return tuple(folds(clouds, min(parameters.folds, clouds), parameters.seed))


@dataclass
class Tuning(ABC, Generic[Network]):
    """One fine-tuning under way: which clouds it is on, from weights or not, and its folds; how networks are trained
    and scored is up to their kind.
    """

    clouds: Sequence[OwnCloud]
    parameters: FineTuneParameters
    chosen: tuple[Fold, ...]
    folder: Path
    progress: Progress
    steps: int = 0
    prepared: ClassVar[float] = 0.08
    """Share of the whole work that preparing the clouds is."""
    timed_steps: ClassVar[int] = 4

    @abstractmethod
    def train(self, chosen: Sequence[int], place: Path, steps: int = 0) -> Network:
        """A network trained on the clouds of these numbers, in evaluation mode."""

    @abstractmethod
    def look(self, network: Network, cloud: OwnCloud, place: Path) -> None:
        """What scoring a cloud takes, to be timed."""

    @abstractmethod
    def score(self, network: Network, fold: Fold, place: Path) -> LabelScores:
        """Scores on a fold's held-out clouds; what the calibration needs of them is kept in ``place``."""

    @property
    @abstractmethod
    def scored_twice(self) -> bool:
        """Whether the weights that training starts from are scored, too."""

    def run(self, plan: Plan) -> Network:
        """Score by folds into ``folder``, then train on all clouds."""
        self.steps = plan.steps(lambda: self.fitting_steps() if self.minutes else self.parameters.steps)
        if self.chosen:
            cross_validate(self.chosen, self.folder, self.train_and_score)
        with self.progress.stage(self.share(len(self.chosen)), 1.0, "training on all files"):
            return self.train(range(len(self.clouds)), self.folder / "all")

    def fold_scores(self) -> list[dict[str, Any]]:
        """The summaries of all folds, as ``cross_validate`` wrote them."""
        found: list[dict[str, Any]] = json.loads((self.folder / "folds.json").read_text(encoding="utf-8"))["folds"]
        return found

    def held_out(self, *names: str) -> list[NDArray]:
        """Arrays of these names that the folds kept, joined."""
        parts: list[list[NDArray]] = []
        for fold in self.chosen:
            with np.load(self.folder / f"fold_{fold.number}" / "held_out.npz", allow_pickle=False) as file:
                parts.append([file[name] for name in names])
        return [np.concatenate(arrays) for arrays in zip(*parts, strict=True)]

    def share(self, number: int) -> float:
        """Share of the whole work that is done before training ``number``."""
        return self.prepared + (1.0 - self.prepared) * number / (len(self.chosen) + 1)

    def train_and_score(self, fold: Fold, place: Path) -> LabelScores:
        """Train on a fold's clouds and score the others."""
        low, high = self.share(fold.number), self.share(fold.number + 1)
        title = f"fold {fold.number + 1} of {len(self.chosen)}"
        with self.progress.stage(low, low + 0.8 * (high - low), title):
            network = self.train(fold.train, place)
        with self.progress.stage(low + 0.8 * (high - low), high, f"scoring {title}"):
            return self.score(network, fold, place)

    @property
    def minutes(self) -> float:
        """That everything may take; 0 where the steps are given."""
        return given(self.parameters.minutes) or 0.0

    def fitting_steps(self) -> int:
        """Steps of each training with which all of them take about the minutes asked for, from a few that are timed."""
        place = self.folder / "timing"
        with cancellation.temporary(place):
            # The first step pays for warming up, and a training's start and end cost the same however long it is.
            self.train(range(len(self.clouds)), place / "first", steps=1)
            begun = time.monotonic()
            network = self.train(range(len(self.clouds)), place / "more", steps=self.timed_steps)
            each = (time.monotonic() - begun) / self.timed_steps
            smallest = min(self.clouds, key=lambda cloud: len(cloud.xyz))
            begun = time.monotonic()
            if self.chosen:
                self.look(network, smallest, place)
            scored = time.monotonic() - begun
        points = sum(len(cloud.xyz) for cloud in self.clouds)
        scoring = scored * points / len(smallest.xyz) * (2 if self.scored_twice else 1)
        left = _MAX_TIME_SHARE * 60.0 * self.minutes - scoring
        steps = max(self.timed_steps, int(left / (each * (len(self.chosen) + 1))))
        if steps < 50:
            self.progress.warning(
                f"Only {steps} steps a training fit into {self.minutes:g} minutes; give more minutes or fewer folds."
            )
        return steps


class Plan:
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


def identity(
    clouds: Sequence[OwnCloud], start_sha256: str | None, parameters: FineTuneParameters, configuration: dict[str, Any]
) -> dict[str, Any]:
    """What makes a training another one: clouds, labels, the weights that it starts from and settings."""
    values = asdict(parameters)
    # What network is trained is stated by ``configuration``: auto and the name of what it stands for are the same.
    for name in ("device", "threads", "start", "network"):
        values.pop(name)
    return {
        "clouds": [[cloud.sha256, cloud.labels_sha256] for cloud in clouds],
        "coordinates": [hashlib.sha256(cloud.xyz[:1000].tobytes()).hexdigest() for cloud in clouds],
        "start": start_sha256,
        "parameters": values,
        "configuration": configuration,
    }


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
