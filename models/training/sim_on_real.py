"""Training of the raster network: hazards put into real and simulated ground anew at every step.

Half of the patches are of real ground, half of simulated; each comes twice, with and without its hazards, so that the
network learns what a hazard adds rather than what the ground around it is. Each step has one new pair and several of
the last made, mirrored anew: making a patch takes as long as a step with it. All that is random depends on the seed
and the step alone: a training that was interrupted gives the same weights as one that was not.
"""

from __future__ import annotations

import csv
import json
import math
import time
import warnings
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
from ...engine.core.staged_outputs import atomic_output
from ..network.unet import UNet, UNetConfiguration
from .loss import combined, root_inverse_weights
from .relief_patches import Ground, Patch, PatchParameters, draw_patches

FREQUENCIES = (0.92, 0.04, 0.04)
"""About the share of the classes' cells on patches with hazards."""


@dataclass(frozen=True)
class ReliefTraining:
    """How the raster network is trained: ``steps`` of ``pairs`` patches with and without hazards each, one of which is
    new; the others are drawn from the ``pool`` last made, which begins with ``first``. A part ``simulated`` of the
    patches is of simulated ground. AdamW, ``learning_rate`` at the peak of one cycle, ``dice`` times Dice's loss next
    to cross-entropy; ``decay`` of the running mean of the weights.
    """

    steps: int = 3000
    pairs: int = 3
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
        if min(self.steps, self.pairs, self.first) < 1 or self.pool < self.first:
            raise InputError(
                f"Training has {self.steps} steps of {self.pairs} pairs from a pool that begins with {self.first} of "
                f"{self.pool}; give at least 1 of each, and not more to begin with than the pool holds."
            )


@dataclass(frozen=True)
class ReliefState:
    """The mean ``network`` so far, the steps done and whether all are."""

    network: UNet
    step: int
    finished: bool


def train_relief(
    configuration: UNetConfiguration,
    real: Sequence[Ground],
    simulated: Sequence[Ground],
    parameters: ReliefTraining,
    folder: Path,
    *,
    seconds: float = math.inf,
    save_every: float = 60.0,
    workers: int = 1,
    progress: Progress | None = None,
) -> ReliefState:
    """Train until all steps are done or ``seconds`` have passed; go on from the checkpoint in ``folder`` if there is
    one. ``folder/log.csv`` has a row every so many steps: step, loss, learning rate, seconds.

    Args:
        real, simulated: ground to cut patches from; one of the two may be empty.
        workers: threads that make patches ahead.

    Raises:
        InputError: there is no ground, or the checkpoint in ``folder`` is of another training.
    """
    if not real and not simulated:
        raise InputError("There is no ground to train on; give real or simulated pieces.")
    progress = progress or Progress()
    folder.mkdir(parents=True, exist_ok=True)
    torch.manual_seed(parameters.seed)
    network = UNet(configuration)
    mean = AveragedModel(network, avg_fn=partial(_running_mean, parameters.decay), use_buffers=True)
    optimiser = torch.optim.AdamW(
        network.parameters(), lr=parameters.learning_rate, weight_decay=parameters.weight_decay
    )
    cycle = OneCycleLR(optimiser, parameters.learning_rate, total_steps=parameters.steps + 1, pct_start=0.2)
    names = [ground.name for ground in (*real, *simulated)]
    # Channels that lie together in memory make convolutions on a processor a fifth faster.
    network.to(memory_format=torch.channels_last)
    checkpoint = _Checkpoint(folder, configuration, parameters, names)
    step = checkpoint.load(network, mean, optimiser, cycle)
    weights = root_inverse_weights(torch.tensor(FREQUENCIES))
    begun = saved = time.monotonic()
    losses: list[float] = []
    every = max(1, min(50, parameters.steps // 20))
    network.train()
    pool: deque[list[Patch]] = deque(maxlen=parameters.pool)
    for made, pair in _ahead(real, simulated, parameters, step, workers):
        pool.append(pair)
        if made < parameters.first + step:
            continue
        if time.monotonic() - begun > seconds:
            break
        values, labels = _batch(_replayed(pool, parameters, step), network.chosen)
        logits = network(values).permute(0, 2, 3, 1).reshape(-1, 3)
        loss = combined(logits, labels.reshape(-1), weights, parameters.dice)
        optimiser.zero_grad(set_to_none=True)
        loss.backward()
        torch.nn.utils.clip_grad_norm_(network.parameters(), parameters.clip)
        optimiser.step()
        cycle.step()
        mean.update_parameters(network)
        step += 1
        losses.append(float(loss.detach()))
        if not math.isfinite(losses[-1]):
            raise InputError(f"The training's loss is not a number after {step} steps; lower the learning rate.")
        if step % every == 0 or step == parameters.steps:
            average = sum(losses) / len(losses)
            _log(folder / "log.csv", step, average, float(cycle.get_last_lr()[0]), time.monotonic() - begun)
            progress.update(step / parameters.steps, f"step {step} of {parameters.steps}, loss {average:.3f}")
            losses.clear()
        if time.monotonic() - saved > save_every:
            checkpoint.save(network, mean, optimiser, step)
            saved = time.monotonic()
    checkpoint.save(network, mean, optimiser, step)
    network.load_state_dict(mean.module.state_dict())
    network.eval()
    return ReliefState(network, step, step >= parameters.steps)


def new_pair(
    real: Sequence[Ground], simulated: Sequence[Ground], parameters: ReliefTraining, number: int
) -> list[Patch]:
    """The pair of that ``number``, with hazards and without; the same number always the same."""
    rng = np.random.default_rng([parameters.seed, number])
    of_simulated = rng.random() < parameters.simulated if real and simulated else bool(simulated)
    return draw_patches(simulated if of_simulated else real, parameters.patch, rng)


def _replayed(pool: Sequence[list[Patch]], parameters: ReliefTraining, step: int) -> list[Patch]:
    """The newest pair and others of the pool, some mirrored along x, some upside down."""
    rng = np.random.default_rng([parameters.seed, step, 1])
    chosen = [len(pool) - 1, *rng.integers(0, len(pool), parameters.pairs - 1)]
    found = []
    for number in chosen:
        along, inverse = rng.random(2) < 0.5
        found += [patch.mirrored(along=bool(along), upside_down=bool(inverse)) for patch in pool[number]]
    return found


def _ahead(
    real: Sequence[Ground], simulated: Sequence[Ground], parameters: ReliefTraining, step: int, workers: int
) -> Iterator[tuple[int, list[Patch]]]:
    """Numbered pairs, from the first that the pool of ``step`` holds, made in threads a few ahead."""
    begin = max(0, parameters.first + step + 1 - parameters.pool)
    numbers = iter(range(begin, parameters.first + parameters.steps))
    with ThreadPoolExecutor(workers) as threads:
        waiting: deque[tuple[int, Future[list[Patch]]]] = deque()
        try:
            while True:
                for number in numbers:
                    waiting.append((number, threads.submit(new_pair, real, simulated, parameters, number)))
                    if len(waiting) > workers + 1:
                        break
                if not waiting:
                    return
                number, future = waiting.popleft()
                yield number, future.result()
        finally:
            for _, future in waiting:
                future.cancel()


def _running_mean(decay: float, average: Tensor, value: Tensor, count: Tensor | int) -> Tensor:
    """The plain mean of the first values, an exponential one once there are 1 / (1 - ``decay``) of them."""
    return average + (value - average) * max(1.0 - decay, 1.0 / (int(count) + 1))


def _batch(patches: Sequence[Patch], chosen: Sequence[int]) -> tuple[Tensor, Tensor]:
    values = torch.from_numpy(np.stack([patch.channels for patch in patches])[:, chosen])
    values = values.contiguous(memory_format=torch.channels_last)
    labels = torch.from_numpy(np.stack([patch.labels for patch in patches])).long()
    return values, labels


def _log(path: Path, step: int, loss: float, rate: float, seconds: float) -> None:
    new = not path.exists()
    with path.open("a", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        if new:
            writer.writerow(["step", "loss", "learning_rate", "seconds"])
        writer.writerow([step, f"{loss:.5f}", f"{rate:.6f}", f"{seconds:.1f}"])


class _Checkpoint:
    """Network, its running mean, moments of the optimiser and step as safetensors, what the training is as JSON."""

    def __init__(
        self, folder: Path, configuration: UNetConfiguration, parameters: ReliefTraining, grounds: Sequence[str]
    ) -> None:
        self.tensors = folder / "checkpoint.safetensors"
        self.state = folder / "checkpoint.json"
        what = {"configuration": asdict(configuration), "training": asdict(parameters), "grounds": list(grounds)}
        self.identity = json.loads(json.dumps(what))

    def save(self, network: UNet, mean: AveragedModel, optimiser: torch.optim.Optimizer, step: int) -> None:
        from safetensors.torch import save_file

        tensors = {f"network.{name}": t for name, t in network.state_dict().items()}
        tensors |= {f"mean.{name}": t for name, t in mean.state_dict().items()}
        for index, values in optimiser.state_dict()["state"].items():
            tensors |= {f"optimiser.{index}.{name}": torch.as_tensor(value) for name, value in values.items()}
        tensors["step"] = torch.tensor(step)
        with atomic_output(self.tensors) as partial:
            save_file({name: t.detach().clone().contiguous() for name, t in tensors.items()}, str(partial))
        with atomic_output(self.state) as partial:
            partial.write_text(json.dumps(self.identity, indent=2), encoding="utf-8")

    def load(self, network: UNet, mean: AveragedModel, optimiser: torch.optim.Optimizer, cycle: OneCycleLR) -> int:
        """Take over the checkpoint, if there is one; the number of steps that were done."""
        if not (self.tensors.is_file() and self.state.is_file()):
            return 0
        from safetensors.torch import load_file

        if json.loads(self.state.read_text(encoding="utf-8")) != self.identity:
            raise InputError(
                f"{self.state} is the checkpoint of a training with other settings; choose another folder or remove it."
            )
        tensors = load_file(str(self.tensors))
        for prefix, module in (("network.", network), ("mean.", mean)):
            module.load_state_dict({n.removeprefix(prefix): t for n, t in tensors.items() if n.startswith(prefix)})
        moments: dict[int, dict[str, Tensor]] = {}
        for name, tensor in tensors.items():
            if name.startswith("optimiser."):
                _, index, key = name.split(".", 2)
                moments.setdefault(int(index), {})[key] = tensor
        known = optimiser.state_dict()
        known["state"] = moments
        optimiser.load_state_dict(known)
        step = int(tensors["step"])
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", "Detected call of `lr_scheduler.step", UserWarning)
            for _ in range(step):
                cycle.step()
        return step
