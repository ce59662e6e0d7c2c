"""Weights of the raster network, trained on real ground of a folder and on simulated slopes."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import torch

from ...engine.core.progress import Progress
from ...models.network.relief_looks import UNetConfiguration
from ...models.network.unet import UNet
from ...models.training.relief_patches import Grounds
from ...models.training.sim_on_real import ReliefTraining, train_relief
from .relief_grounds import real_grounds, simulated_grounds


def relief_grounds(folder: Path | None, left_out: Sequence[str], slopes: int, progress: Progress) -> Grounds:
    """Real ground of a folder without the surveys ``left_out``, if a folder is given, and simulated slopes."""
    real = real_grounds(folder, left_out) if folder is not None else []
    with progress.stage(0.0, 0.1, "simulating slopes"):
        return Grounds(real, simulated_grounds(slopes, progress))


def train_relief_weights(
    grounds: Grounds,
    folder: Path,
    parameters: ReliefTraining,
    *,
    left_out: Sequence[str] = (),
    start: UNet | None = None,
    seconds: float = math.inf,
    progress: Progress | None = None,
) -> tuple[UNet, dict[str, Any]] | None:
    """Train from nothing, or go on from the checkpoint in ``folder``.

    Args:
        left_out: surveys that are not in ``grounds``, for the record.
        start: what training starts from; a new network without.

    Returns:
        The network and facts about its training; None where ``seconds`` did not suffice: run again to go on.
    """
    progress = progress or Progress()
    begun = time.process_time()
    with progress.stage(0.1, 1.0, "training"):
        state = train_relief(
            UNetConfiguration(), grounds, parameters, folder, start=start, seconds=seconds, progress=progress
        )
    if not state.finished:
        return None
    facts = {
        **asdict(parameters),
        "real_ground": [ground.name for ground in grounds.real],
        "left_out": list(left_out),
        "simulated_slopes": len(grounds.simulated),
        "torch": torch.__version__,
        "processor_seconds": round(time.process_time() - begun),
    }
    return state.network, facts
