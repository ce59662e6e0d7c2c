"""Training of the raster network: hazards put into real and simulated ground anew at every step.

Half of the patches are of real ground, half of simulated. Each step has one new patch and several of the last made,
mirrored anew: making a patch takes as long as a step with it. All that is random depends on the seed and the step
alone: a training that was interrupted gives the same weights as one that was not.
"""

from __future__ import annotations

import json
import math
import time
import warnings
from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import asdict, dataclass, field
from functools import partial
from pathlib import Path

import numpy as np
import torch
from torch import Tensor
from torch.optim.lr_scheduler import OneCycleLR
from torch.optim.swa_utils import AveragedModel

from ...engine.core.errors import InputError
from ...engine.core.progress import Progress
from ...engine.core.staged_outputs import atomic_output
from ..network.unet import UNet, UNetConfiguration
from .loss import combined, root_inverse_weights
from .relief_patches import Grounds, Patch, PatchParameters, draw_patch
from .step_log import append_step

FREQUENCIES = (0.92, 0.04, 0.04)
"""About the share of the classes' cells on patches with hazards."""
_AHEAD = 3


@dataclass(frozen=True)
class ReliefTraining:
    """How the raster network is trained: ``steps`` of ``patches`` each, one of which is new; the others are drawn from
    the ``pool`` last made, which begins with ``first``. A part ``simulated`` of the patches is of simulated ground.
    AdamW, ``learning_rate`` at the peak of one cycle, ``dice`` times Dice's loss next to cross-entropy; ``decay`` of
    the running mean of the weights.
    """

    steps: int = 3000
    patches: int = 5
    pool: int = 200
    first: int = 20
    simulated: float = 0.5
    learning_rate: float = 4e-3
    weight_decay: float = 1e-3
    dice: float = 0.5
    decay: float = 0.998
    clip: float = 2.0
    seed: int = 0
    patch: PatchParameters = field(default_factory=PatchParameters)

    def __post_init__(self) -> None:
        if min(self.steps, self.patches, self.first) < 1 or self.pool < self.first:
            raise InputError(
                f"Training has {self.steps} steps of {self.patches} patches from a pool that begins with {self.first} "
                f"of {self.pool}; give at least 1 of each, and not more to begin with than the pool holds."
            )


@dataclass(frozen=True)
class ReliefState:
    """The mean ``network`` so far, the steps done and whether all are."""

    network: UNet
    step: int
    finished: bool


def train_relief(
    configuration: UNetConfiguration,
    grounds: Grounds,
    parameters: ReliefTraining,
    folder: Path,
    *,
    seconds: float = math.inf,
    save_every: float = 60.0,
    progress: Progress | None = None,
) -> ReliefState:
    """Train until all steps are done or ``seconds`` have passed; go on from the checkpoint in ``folder`` if there is
    one. ``folder/log.csv`` has a row every so many steps: step, loss, learning rate, seconds.

    Args:
        save_every: seconds between checkpoints.

    Raises:
        InputError: the checkpoint in ``folder`` is of another training.
    """
    progress = progress or Progress()
    folder.mkdir(parents=True, exist_ok=True)
    learner = _Learner(configuration, parameters)
    checkpoint = _Checkpoint(folder, configuration, parameters, grounds.names)
    step = checkpoint.load(learner)
    begun = saved = time.monotonic()
    losses: list[float] = []
    every = max(1, min(50, parameters.steps // 20))
    for patches in _batches(grounds, parameters, step):
        if time.monotonic() - begun > seconds:
            break
        losses.append(learner.learn(patches))
        step += 1
        if not math.isfinite(losses[-1]):
            raise InputError(f"The training's loss is not a number after {step} steps; lower the learning rate.")
        if step % every == 0 or step == parameters.steps:
            average = sum(losses) / len(losses)
            append_step(folder / "log.csv", step, average, learner.rate, time.monotonic() - begun)
            progress.update(step / parameters.steps, f"step {step} of {parameters.steps}, loss {average:.3f}")
            losses.clear()
        if time.monotonic() - saved > save_every:
            checkpoint.save(learner, step)
            saved = time.monotonic()
    checkpoint.save(learner, step)
    network = learner.network
    network.load_state_dict(learner.mean.module.state_dict())
    network.eval()
    return ReliefState(network, step, step >= parameters.steps)


class _Learner:
    """The network, the running mean of its weights, and what changes them."""

    def __init__(self, configuration: UNetConfiguration, parameters: ReliefTraining) -> None:
        torch.manual_seed(parameters.seed)
        self.parameters = parameters
        self.network = UNet(configuration)
        self.network.train()
        self.mean = AveragedModel(self.network, avg_fn=partial(_running_mean, parameters.decay), use_buffers=True)
        self.optimiser = torch.optim.AdamW(
            self.network.parameters(), lr=parameters.learning_rate, weight_decay=parameters.weight_decay
        )
        self.cycle = OneCycleLR(
            self.optimiser, parameters.learning_rate, total_steps=parameters.steps + 1, pct_start=0.2
        )
        self.weights = root_inverse_weights(torch.tensor(FREQUENCIES))

    @property
    def rate(self) -> float:
        """The learning rate of the next step."""
        return float(self.cycle.get_last_lr()[0])

    def learn(self, patches: Sequence[Patch]) -> float:
        """One step; its loss."""
        values, labels = _batch(patches, self.network.chosen)
        logits = self.network(values).permute(0, 2, 3, 1).reshape(-1, 3)
        loss = combined(logits, labels.reshape(-1), self.weights, self.parameters.dice)
        self.optimiser.zero_grad(set_to_none=True)
        loss.backward()
        torch.nn.utils.clip_grad_norm_(self.network.parameters(), self.parameters.clip)
        self.optimiser.step()
        self.cycle.step()
        self.mean.update_parameters(self.network)
        return float(loss.detach())

    def tensors(self) -> dict[str, Tensor]:
        """All that the next step depends on but for its number."""
        found = {f"network.{name}": t for name, t in self.network.state_dict().items()}
        found |= {f"mean.{name}": t for name, t in self.mean.state_dict().items()}
        for index, values in self.optimiser.state_dict()["state"].items():
            found |= {f"optimiser.{index}.{name}": torch.as_tensor(value) for name, value in values.items()}
        return found

    def restore(self, tensors: Mapping[str, Tensor], step: int) -> None:
        for prefix, module in (("network.", self.network), ("mean.", self.mean)):
            module.load_state_dict({n.removeprefix(prefix): t for n, t in tensors.items() if n.startswith(prefix)})
        moments: dict[int, dict[str, Tensor]] = {}
        for name, tensor in tensors.items():
            if name.startswith("optimiser."):
                _, index, key = name.split(".", 2)
                moments.setdefault(int(index), {})[key] = tensor
        known = self.optimiser.state_dict()
        known["state"] = moments
        self.optimiser.load_state_dict(known)
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", "Detected call of `lr_scheduler.step", UserWarning)
            for _ in range(step):
                self.cycle.step()


def new_patch(grounds: Grounds, parameters: ReliefTraining, number: int) -> Patch:
    """The patch of that ``number``; the same number always the same."""
    rng = np.random.default_rng([parameters.seed, number])
    both = bool(grounds.real) and bool(grounds.simulated)
    of_simulated = rng.random() < parameters.simulated if both else bool(grounds.simulated)
    return draw_patch(grounds.simulated if of_simulated else grounds.real, parameters.patch, rng)


def _batches(grounds: Grounds, parameters: ReliefTraining, step: int) -> Iterator[list[Patch]]:
    """The patches of each step from ``step`` on, made a few steps ahead in a thread of their own."""
    begin = max(0, parameters.first + step + 1 - parameters.pool)
    pool: deque[Patch] = deque(maxlen=parameters.pool)
    waiting: deque[Future[Patch]] = deque()
    end = parameters.first + parameters.steps
    with ThreadPoolExecutor(1) as thread:
        try:
            for number in range(begin, end):
                for ahead in range(number + len(waiting), min(number + _AHEAD, end)):
                    waiting.append(thread.submit(new_patch, grounds, parameters, ahead))
                pool.append(waiting.popleft().result())
                if number >= parameters.first + step:
                    yield _replayed(pool, parameters, number - parameters.first)
        finally:
            for future in waiting:
                future.cancel()


def _replayed(pool: Sequence[Patch], parameters: ReliefTraining, step: int) -> list[Patch]:
    """The newest patch and others of the pool, some mirrored along x, some upside down."""
    rng = np.random.default_rng([parameters.seed, step, 1])
    chosen = [len(pool) - 1, *rng.integers(0, len(pool), parameters.patches - 1)]
    found = []
    for number in chosen:
        along, inverse = rng.random(2) < 0.5
        found.append(pool[number].mirrored(along=bool(along), upside_down=bool(inverse)))
    return found


def _running_mean(decay: float, average: Tensor, value: Tensor, count: Tensor | int) -> Tensor:
    """The plain mean of the first values, an exponential one once there are 1 / (1 - ``decay``) of them."""
    return average + (value - average) * max(1.0 - decay, 1.0 / (int(count) + 1))


def _batch(patches: Sequence[Patch], chosen: Sequence[int]) -> tuple[Tensor, Tensor]:
    values = torch.from_numpy(np.stack([patch.channels for patch in patches])[:, chosen])
    # Channels that lie together in memory make convolutions on a processor a fifth faster.
    values = values.contiguous(memory_format=torch.channels_last)
    labels = torch.from_numpy(np.stack([patch.labels for patch in patches])).long()
    return values, labels


class _Checkpoint:
    """All that a training depends on as safetensors, what it is as JSON."""

    def __init__(
        self, folder: Path, configuration: UNetConfiguration, parameters: ReliefTraining, grounds: Sequence[str]
    ) -> None:
        self.tensors = folder / "checkpoint.safetensors"
        self.state = folder / "checkpoint.json"
        what = {"configuration": asdict(configuration), "training": asdict(parameters), "grounds": list(grounds)}
        self.identity = json.loads(json.dumps(what))

    def save(self, learner: _Learner, step: int) -> None:
        from safetensors.torch import save_file

        tensors = {**learner.tensors(), "step": torch.tensor(step)}
        with atomic_output(self.tensors) as partial_file:
            save_file({name: t.detach().clone().contiguous() for name, t in tensors.items()}, str(partial_file))
        with atomic_output(self.state) as partial_file:
            partial_file.write_text(json.dumps(self.identity, indent=2), encoding="utf-8")

    def load(self, learner: _Learner) -> int:
        """Take over the checkpoint, if there is one; the number of steps that were done."""
        if not (self.tensors.is_file() and self.state.is_file()):
            return 0
        from safetensors.torch import load_file

        if json.loads(self.state.read_text(encoding="utf-8")) != self.identity:
            raise InputError(
                f"{self.state} is the checkpoint of a training with other settings; choose another folder or remove it."
            )
        tensors = load_file(str(self.tensors))
        step = int(tensors["step"])
        learner.restore(tensors, step)
        return step
