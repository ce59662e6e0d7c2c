"""Fine-tuning of the network on relief on labelled clouds.

Patches are of the user's own ground with its labels, and hazards are put in where that is background, as when the
shipped weights were made. There is no other ground among them that would keep up what the network learnt before: a low
learning rate and a moderate number of steps have to.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch

from ...engine.core.progress import Progress
from ...engine.core.staged_outputs import atomic_output
from ...interface.parameters import FineTuneParameters, given
from ..inference.platt import Platt, platt
from ..network.description import RELIEF
from ..network.relief_looks import UNetConfiguration
from ..network.unet import UNet, load_unet, save_unet
from ..network.weights import save_tensors
from ..preparation.inserted_hazards import ground_density, thinned
from ..screening.relief import calibration_of
from .cross_validation import Fold
from .own_data import OwnCloud
from .relief_patches import Ground, Grounds, PatchParameters
from .relief_scores import (
    ReliefScores,
    held_out_cells,
    labelled_raster,
    pooled_zones,
    relief_screening,
    screened,
)
from .sim_on_real import ReliefTraining, train_relief
from .tuning import HELD_OUT, Plan, Tuning, chosen_folds, identity, pooled_scores

FROM_WEIGHTS, FROM_NOTHING = 5e-4, 4e-3
"""Learning rates where none is given."""
PATCHES = 5
"""In a step, where their number is not given."""
_MEAN_SHARE = 0.1
"""The weights are a running mean over about this share of the steps."""
_WEIGHTS = "weights.safetensors"


@dataclass(frozen=True)
class ReliefStart:
    """Weights to start from, read from ``path``, with their description."""

    network: UNet
    path: Path
    description: dict[str, Any]

    @classmethod
    def read(cls, path: Path, sha256: str | None = None) -> ReliefStart:
        """Raises InputError as ``unet.load_unet``, or where the description's calibration is none."""
        network, description = load_unet(path, sha256)
        calibration_of(description)
        return cls(network, path, description)

    @property
    def sha256(self) -> str:
        return str(self.description["sha256"])


@dataclass(frozen=True)
class ReliefTuned:
    """A network on relief trained on all clouds, how it was scored (None where one cloud left nothing to score on) and
    calibrated: by ``calibration`` fitted on held-out cells, or as the weights that it started from are; the steps of
    each training and its other ``settings``.
    """

    network: UNet
    folds: tuple[Fold, ...]
    scores: dict[str, Any] | None
    calibration: Platt | None
    applied: tuple[float, float]
    steps: int
    settings: ReliefTraining

    def save(self, path: Path, facts: dict[str, Any], metrics: dict[str, Any]) -> str:
        """Write weights and description, which screening reads; the weights' SHA-256."""
        scale, shift = self.applied
        return save_tensors(
            path,
            self.network.state_dict(),
            {
                "kind": RELIEF,
                "configuration": asdict(self.network.configuration),
                "parameters": self.network.parameter_count,
                "calibration": {"scale": scale, "shift": shift},
                "training": {**facts, "recipe": asdict(self.settings)},
                "metrics": metrics,
            },
        )

    def figures(self) -> dict[str, Any]:
        """What the run record says beyond the scores of points."""
        names = ("hazards", "hazard_recall", "false_zones_per_1000_m2")
        scores = self.scores or {}
        found = {key: scores.get(key) for name in names for key in (name, f"start_{name}")}
        scale, shift = self.applied
        return found | {"calibration_scale": round(scale, 4), "calibration_shift": round(shift, 4)}


def fine_tune_relief(
    clouds: Sequence[OwnCloud],
    start: ReliefStart | None,
    parameters: FineTuneParameters,
    folder: Path,
    *,
    patch: PatchParameters | None = None,
    device: torch.device | None = None,
    progress: Progress | None = None,
) -> ReliefTuned:
    """As ``fine_tuning.fine_tune`` for the network on relief; ``patch`` is how patches are made."""
    device, progress = device or torch.device("cpu"), progress or Progress()
    configuration = start.network.configuration if start else UNetConfiguration()
    base = ReliefTraining(
        patches=int(given(parameters.batch) or PATCHES),
        learning_rate=given(parameters.learning_rate) or (FROM_WEIGHTS if start else FROM_NOTHING),
        seed=parameters.seed,
        patch=patch or PatchParameters(),
    )
    chosen = chosen_folds(len(clouds), parameters)
    facts = {"network": asdict(configuration), "training": asdict(base)}
    plan = Plan(folder, identity(clouds, start.sha256 if start else None, parameters, facts))
    with progress.stage(0.0, Tuning.prepared, "preparing the clouds"):
        grounds = [own_ground(cloud, base.patch.densities[1], number) for number, cloud in enumerate(clouds)]
    run = _ReliefTuning(
        clouds, parameters, chosen, folder, progress, grounds=grounds, start=start, base=base, device=device
    )
    network = run.run(plan)
    applied = calibration_of(start.description) if start else (1.0, 0.0)
    scores = calibration = None
    if chosen:
        results = run.fold_scores()
        scores = pooled_scores(results) | pooled_zones(results)
        calibration = run.calibration()
        applied = (calibration.scale, calibration.shift) if calibration else applied
    return ReliefTuned(network, chosen, scores, calibration, applied, run.steps, run.settings(run.steps))


def own_ground(cloud: OwnCloud, densest: float, seed: int) -> Ground:
    """A labelled cloud as ground to cut patches from, thinned to ``densest`` points/m²; drawn by its extent.

    Raises:
        InputError: it has too few points.
    """
    chosen = thinned(cloud.xyz, densest, np.random.default_rng(seed))
    points = cloud.xyz[chosen]
    density = ground_density(points[:, :2])
    return Ground(
        cloud.name,
        points - points.mean(axis=0),
        density,
        weight=len(points) / density,
        labels=cloud.labels[chosen],
    )


@dataclass(kw_only=True)
class _ReliefTuning(Tuning[UNet]):
    grounds: list[Ground]
    start: ReliefStart | None
    base: ReliefTraining
    device: torch.device
    timed_steps = 8

    @property
    def scored_twice(self) -> bool:
        return self.start is not None

    def settings(self, steps: int) -> ReliefTraining:
        """The pool of patches and the running mean fit so many steps."""
        first = min(self.base.first, max(self.base.patches, steps // 10))
        decay = min(self.base.decay, max(0.0, 1.0 - 1.0 / (_MEAN_SHARE * steps)))
        return replace(self.base, steps=steps, first=first, decay=decay)

    def train(self, chosen: Sequence[int], place: Path, steps: int = 0) -> UNet:
        settings = self.settings(steps or self.steps)
        if self.start is None:
            torch.manual_seed(settings.seed)
        begin = self.start.network if self.start else UNet(UNetConfiguration())
        state = train_relief(
            begin.configuration,
            Grounds([self.grounds[number] for number in chosen]),
            settings,
            place,
            start=begin.to(self.device),
            progress=self.progress,
        )
        return state.network

    def score(self, network: UNet, fold: Fold, place: Path) -> ReliefScores:
        models = [relief_screening(self._written(network, place), self.parameters.threads, self.device_name)]
        if self.start:
            models.append(relief_screening(self.start.path, self.parameters.threads, self.device_name))
        scores, kept = ReliefScores(), []
        for place_in_fold, number in enumerate(fold.test):
            cloud = self.clouds[number]
            self.progress.update(place_in_fold / len(fold.test), f"scoring {cloud.name}")
            raster = labelled_raster(cloud)
            said = [screened(model, raster) for model in models]
            scores.add(cloud, raster, said[0])
            if self.start:
                scores.add_start(cloud, raster, said[1])
            rng = np.random.default_rng([self.parameters.seed, number])
            kept.append(held_out_cells(raster, said[0].probabilities, HELD_OUT, rng))
        log_odds, labels, weights = (np.concatenate(parts) for parts in zip(*kept, strict=True))
        with atomic_output(place / "held_out.npz") as partial:
            np.savez(partial, log_odds=log_odds, labels=labels, weights=weights)
        return scores

    def look(self, network: UNet, cloud: OwnCloud, place: Path) -> None:
        screened(
            relief_screening(self._written(network, place), self.parameters.threads, self.device_name),
            labelled_raster(cloud),
        )

    @property
    def device_name(self) -> str:
        return "cpu" if self.device.type == "cpu" else "gpu"

    def calibration(self) -> Platt | None:
        """Scale and shift on the held-out cells of all folds; None where these are of one class."""
        log_odds, labels, weights = self.held_out("log_odds", "labels", "weights")
        if len(np.unique(labels)) < 2:
            self.progress.warning("The held-out ground is of one class; there is nothing to calibrate with.")
            return None
        return platt(log_odds, labels, weights)

    @staticmethod
    def _written(network: UNet, place: Path) -> Path:
        """The network in a file of its own, as screening reads it, without calibration."""
        path = place / _WEIGHTS
        save_unet(path, network, {}, {})
        return path
