"""Training of the raster network: hazards put into real and simulated ground anew at every step.

Half of the patches are of real ground, half of simulated. Each step has one new patch and several of the last made,
mirrored anew: making a patch takes as long as a step with it. All that is random depends on the seed and the step
alone: a training that was interrupted gives the same weights as one that was not. Training may start from weights; the
same machinery then fits them to labelled ground.
"""

from __future__ import annotations

import hashlib
import math
import time
from collections import deque
from collections.abc import Iterator, Sequence
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
from ..network.relief_looks import UNetConfiguration
from ..network.unet import UNet
from .checkpoint import Checkpoint, advance, module_tensors, moments, restore_module, restore_moments
from .loss import combined, root_inverse_weights
from .relief_patches import Grounds, Patch, PatchParameters, draw_patch
from .step_log import append_step

FREQUENCIES = (0.92, 0.04, 0.04)
"""About the share of the classes' cells on patches with hazards."""
SAVE_EVERY_S = 30.0
"""Between checkpoints."""
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
    start: UNet | None = None,
    seconds: float = math.inf,
    progress: Progress | None = None,
) -> ReliefState:
    """Train until all steps are done or ``seconds`` have passed; go on from the checkpoint in ``folder`` if there is
    one. ``folder/log.csv`` has a row every so many steps: step, loss, learning rate, seconds.

    Args:
        start: what training starts from, on the device that it is on; without, a new network on the processor.

    Raises:
        InputError: the checkpoint in ``folder`` is of another training; ``start`` has another configuration.
    """
    progress = progress or Progress()
    folder.mkdir(parents=True, exist_ok=True)
    learner = _Learner(configuration, parameters, start)
    what = {
        "configuration": asdict(configuration),
        "training": asdict(parameters),
        "grounds": grounds.names,
        "start": None if start is None else state_sha256(start),
    }
    checkpoint = Checkpoint(folder, what)
    step = learner.restore(checkpoint)
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
        if time.monotonic() - saved > SAVE_EVERY_S:
            checkpoint.save(learner.tensors(), step)
            saved = time.monotonic()
    checkpoint.save(learner.tensors(), step)
    network = learner.network
    network.load_state_dict(learner.mean.module.state_dict())
    network.eval()
    return ReliefState(network, step, step >= parameters.steps)


class _Learner:
    """The network, the running mean of its weights, and what changes them."""

    def __init__(self, configuration: UNetConfiguration, parameters: ReliefTraining, start: UNet | None) -> None:
        torch.manual_seed(parameters.seed)
        self.parameters = parameters
        self.network = UNet(configuration)
        if start is not None:
            if start.configuration != configuration:
                raise InputError("The network to start from has other channels or widths; give one of the same.")
            self.network.load_state_dict(start.state_dict())
            self.network.to(start.head.weight.device)
        self.device = self.network.head.weight.device
        self.network.train()
        self.mean = AveragedModel(self.network, avg_fn=partial(_running_mean, parameters.decay), use_buffers=True)
        self.optimiser = torch.optim.AdamW(
            self.network.parameters(), lr=parameters.learning_rate, weight_decay=parameters.weight_decay
        )
        # Torch's cycle needs more than one step on the way up.
        rise = 0.2 if parameters.steps > 4 else 0.6
        self.cycle = OneCycleLR(
            self.optimiser, parameters.learning_rate, total_steps=parameters.steps + 1, pct_start=rise
        )
        self.weights = root_inverse_weights(torch.tensor(FREQUENCIES)).to(self.device)

    @property
    def rate(self) -> float:
        """The learning rate of the next step."""
        return float(self.cycle.get_last_lr()[0])

    def learn(self, patches: Sequence[Patch]) -> float:
        """One step; its loss."""
        values, labels = _batch(patches, self.network.chosen)
        labels = labels.to(self.device)
        logits = self.network(values.to(self.device)).permute(0, 2, 3, 1).reshape(-1, 3)
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
        networks = module_tensors(self.network, "network") | module_tensors(self.mean, "mean")
        return {**networks, **moments(self.optimiser)}

    def restore(self, checkpoint: Checkpoint) -> int:
        """Take over the checkpoint, if there is one; the number of steps that were done."""
        found = checkpoint.load(self.device)
        if found is None:
            return 0
        tensors, step = found
        restore_module(self.network, "network", tensors)
        restore_module(self.mean, "mean", tensors)
        advance(self.cycle, step)
        restore_moments(self.optimiser, tensors)
        return step


def state_sha256(network: UNet) -> str:
    """SHA-256 of all weights of a network."""
    found = hashlib.sha256()
    for name, tensor in network.state_dict().items():
        found.update(name.encode())
        found.update(tensor.detach().cpu().numpy().tobytes())
    return found.hexdigest()


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
