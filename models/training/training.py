"""Training with a fixed number of steps that can stop at any time and go on later as if it had not stopped."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path

import numpy as np
import torch
from torch import Tensor
from torch.optim.lr_scheduler import CosineAnnealingLR, LinearLR, SequentialLR

from ...engine.core.errors import InputError
from ...engine.core.progress import Progress
from ..configuration import ModelConfiguration
from ..network.batches import NO_AUGMENTATION, Augmentation, Batch, ResidentBlocks, make_batch, network_inputs
from ..network.randlanet import RandLANet
from ..preparation.prepare import UNKNOWN, Block
from .checkpoint import Checkpoint, advance, module_tensors, moments, restore_module, restore_moments
from .loss import combined, published_weights, root_inverse_weights
from .step_log import append_step


@dataclass(frozen=True)
class TrainingParameters:
    """How a model is trained.

    ``steps`` of ``batch`` blocks each; AdamW with ``learning_rate`` that warms up over 5 % of the steps and falls to
    0 along a cosine. ``weighting``: of the classes, ``published`` (min(1 / (freq + eps), w_max)) or ``root`` (inverse
    root of the frequency). ``dice``: share of the Dice loss. ``bfloat16``: half-precision arithmetic, for a GPU or a
    processor that has it: with AVX-512 BF16 a step of 131,072 points took 2.2 s in place of 3.9.
    """

    steps: int = 2000
    batch: int = 4
    learning_rate: float = 0.01
    weight_decay: float = 1e-4
    weighting: str = "root"
    eps: float = 0.02
    w_max: float = 10.0
    dice: float = 1.0
    augmentation: Augmentation = field(default_factory=Augmentation)
    clip: float = 5.0
    seed: int = 0
    bfloat16: bool = False

    def __post_init__(self) -> None:
        if self.weighting not in ("published", "root"):
            raise InputError(f"The weighting of the classes is {self.weighting!r}; give published or root.")
        if self.steps < 1 or self.batch < 1:
            raise InputError(f"Training has {self.steps} steps of {self.batch} blocks; give at least 1 of each.")


PAPER_TRAINING = TrainingParameters(weighting="published", dice=0.0, augmentation=NO_AUGMENTATION)
"""The published loss, without augmentation."""


@dataclass(frozen=True)
class TrainingState:
    """Where a training stands: the network on its device, the steps done, whether all are."""

    network: RandLANet
    step: int
    finished: bool


Provider = Callable[[int], Batch]
"""Gives the batch of a step; the same step always the same batch."""


def block_provider(blocks: Sequence[Block], parameters: TrainingParameters, device: torch.device) -> Provider:
    """Batches of random blocks: every block once before any comes again.

    On a GPU all blocks are put there at once; on a processor batches are made when they are asked for.
    """
    if not blocks:
        raise InputError("There are no blocks to train on; give clouds with labelled points.")
    size = min(parameters.batch, len(blocks))
    rounds = len(blocks) // size
    resident = ResidentBlocks(blocks, device) if device.type != "cpu" else None

    def provide(step: int) -> Batch:
        order = np.random.default_rng([parameters.seed, step // rounds]).permutation(len(blocks))
        start = (step % rounds) * size
        chosen = [int(k) for k in order[start : start + size]]
        return resident.batch(chosen) if resident else make_batch([blocks[k] for k in chosen])

    return provide


def class_frequencies(blocks: Sequence[Block], classes: int) -> Tensor:
    """Share of each class among the points whose label is known."""
    count = sum(np.bincount(block.labels[block.labels != UNKNOWN], minlength=classes) for block in blocks)
    total = int(np.sum(count))
    if not total:
        raise InputError("None of the points to train on has a label; label some or give other clouds.")
    return torch.from_numpy(np.asarray(count) / total).float()


def train(
    configuration: ModelConfiguration,
    provider: Provider,
    frequencies: Tensor,
    parameters: TrainingParameters,
    folder: Path,
    *,
    device: torch.device | None = None,
    start: RandLANet | None = None,
    seconds: float = math.inf,
    save_every: float = 60.0,
    progress: Progress | None = None,
) -> TrainingState:
    """Train until all steps are done or ``seconds`` have passed; go on from the checkpoint in ``folder`` if there is
    one.

    A training that stopped and went on gives the same weights as one that did not (on one device and library version).
    ``folder/log.csv`` has a row every so many steps: step, loss, learning rate, seconds.

    Args:
        provider: batches on ``device``.
        frequencies: (classes,) shares of the classes.
        start: network to fine-tune; a fresh one by default. Not used where there is a checkpoint.
        save_every: seconds between checkpoints.

    Raises:
        InputError: the checkpoint in ``folder`` is of another training.
    """
    device = device or torch.device("cpu")
    progress = progress or Progress()
    folder.mkdir(parents=True, exist_ok=True)
    torch.manual_seed(parameters.seed)
    network = RandLANet(configuration)
    if start is not None:
        network.load_state_dict(start.state_dict())
    network.to(device)
    optimiser = torch.optim.AdamW(
        network.parameters(), lr=parameters.learning_rate, weight_decay=parameters.weight_decay
    )
    schedule = learning_rates(optimiser, parameters)
    checkpoint = Checkpoint(folder, {"configuration": asdict(configuration), "training": asdict(parameters)})
    step = _restored(checkpoint, network, optimiser, schedule, device)
    if parameters.weighting == "published":
        weights = published_weights(frequencies, parameters.eps, parameters.w_max)
    else:
        weights = root_inverse_weights(frequencies)
    weights = weights.to(device)
    begun = saved = time.monotonic()
    losses: list[float] = []
    every = max(1, parameters.steps // 200)
    network.train()
    while step < parameters.steps and time.monotonic() - begun < seconds:
        rate = float(schedule.get_last_lr()[0])
        losses.append(_step(network, optimiser, provider(step), weights, parameters, step))
        schedule.step()
        step += 1
        if not math.isfinite(losses[-1]):
            raise InputError(f"The training's loss is not a number after {step} steps; lower the learning rate.")
        if step % every == 0 or step == parameters.steps:
            mean = sum(losses) / len(losses)
            append_step(folder / "log.csv", step, mean, rate, time.monotonic() - begun)
            progress.update(step / parameters.steps, f"training: step {step} of {parameters.steps}, loss {mean:.3f}")
            losses.clear()
        if time.monotonic() - saved > save_every:
            checkpoint.save(_tensors(network, optimiser), step)
            saved = time.monotonic()
    checkpoint.save(_tensors(network, optimiser), step)
    network.eval()
    return TrainingState(network, step, step >= parameters.steps)


def learning_rates(optimiser: torch.optim.Optimizer, parameters: TrainingParameters) -> SequentialLR:
    """Linear warm-up over the first 5 % of the steps, then half a cosine to 0."""
    warm = max(1, round(0.05 * parameters.steps))
    rising = LinearLR(optimiser, start_factor=1.0 / warm, total_iters=warm - 1)
    falling = CosineAnnealingLR(optimiser, T_max=max(1, parameters.steps - warm))
    return SequentialLR(optimiser, [rising, falling], milestones=[warm])


def _tensors(network: RandLANet, optimiser: torch.optim.Optimizer) -> dict[str, Tensor]:
    return {**module_tensors(network, "network"), **moments(optimiser)}


def _restored(
    checkpoint: Checkpoint,
    network: RandLANet,
    optimiser: torch.optim.Optimizer,
    schedule: SequentialLR,
    device: torch.device,
) -> int:
    """Take over the checkpoint, if there is one; the number of steps that were done."""
    found = checkpoint.load(device)
    if found is None:
        return 0
    tensors, step = found
    restore_module(network, "network", tensors)
    advance(schedule, step)
    restore_moments(optimiser, tensors)
    return step


def _step(
    network: RandLANet,
    optimiser: torch.optim.Optimizer,
    batch: Batch,
    weights: Tensor,
    parameters: TrainingParameters,
    step: int,
) -> float:
    """One step; all that is random in it depends on the seed and the step alone."""
    generator = torch.Generator().manual_seed(parameters.seed * 1_000_003 + step)
    torch.manual_seed(parameters.seed * 1_000_003 + step)
    coordinates = parameters.augmentation(batch, generator)
    features, scaled = network_inputs(coordinates, batch.residuals, network.configuration)
    device_type = coordinates.device.type
    with torch.autocast(device_type, dtype=torch.bfloat16, enabled=parameters.bfloat16):
        logits = network(features, scaled, batch.graphs)
    loss = combined(logits.float(), batch.labels, weights, parameters.dice)
    optimiser.zero_grad(set_to_none=True)
    loss.backward()
    torch.nn.utils.clip_grad_norm_(network.parameters(), parameters.clip)
    optimiser.step()
    return float(loss.detach())
