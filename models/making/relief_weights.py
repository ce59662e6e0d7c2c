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
from ..network.unet import UNet, UNetConfiguration
from ..training.sim_on_real import ReliefTraining, train_relief
from .relief_grounds import real_grounds, simulated_grounds

SIMULATED_SLOPES = 60


def train_relief_weights(
    grounds: Path | None,
    folder: Path,
    parameters: ReliefTraining,
    *,
    left_out: Sequence[str] = (),
    slopes: int = SIMULATED_SLOPES,
    seconds: float = math.inf,
    progress: Progress | None = None,
) -> tuple[UNet, dict[str, Any]] | None:
    """Train from nothing, or go on from the checkpoint in ``folder``.

    Args:
        grounds: folder of real ground (``relief_grounds.SITES``); simulated slopes alone without it.
        left_out: surveys that the network must not see.
        slopes: number of simulated slopes; real ground alone with 0.

    Returns:
        The network and facts about its training; None where ``seconds`` did not suffice: run again to go on.
    """
    progress = progress or Progress()
    begun = time.process_time()
    real = real_grounds(grounds, left_out) if grounds is not None else []
    with progress.stage(0.0, 0.1, "simulating slopes"):
        simulated = simulated_grounds(slopes, progress)
    with progress.stage(0.1, 1.0, "training"):
        state = train_relief(
            UNetConfiguration(), real, simulated, parameters, folder, seconds=seconds, progress=progress
        )
    if not state.finished:
        return None
    facts = {
        **asdict(parameters),
        "real_ground": [ground.name for ground in real],
        "left_out": list(left_out),
        "simulated_slopes": len(simulated),
        "torch": torch.__version__,
        "processor_seconds": round(time.process_time() - begun),
    }
    return state.network, facts
