"""Screening by the network on rasters of relief: zones whose log odds stand out of the slope's own.

The network's log odds decide relative to the bulk of the slope (``relative_scores``); its probabilities, calibrated on
ground that it did not learn from, are what is told of a zone.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import softmax

from ...engine.core.arrays import Float32
from ...engine.core.blas_threads import one_blas_thread
from ...engine.core.errors import InputError
from ...engine.core.messages import quoted
from ...engine.core.processors import processors
from ...engine.core.progress import Progress
from ...interface.parameters import ScreeningParameters, given
from ..network.availability import chosen_device, require_libraries
from ..network.plain_unet import load_plain_unet
from ..network.relief_looks import ReliefNetwork, log_odds, raster_logits
from ..network.shipped import shipped_relief
from ..preparation.bump_filter import CellHeights
from ..preparation.raster_zones import Scores
from ..preparation.relative_scores import relative_scores
from ..preparation.relief_channels import relief_channels
from .network import MAX_THREADS, memory_reported, one_torch_thread, refuse_senseless

RELIEF_DENSITY = (0.8, 450.0)
"""Ground points/m² that the network is made for."""


@dataclass(frozen=True)
class ReliefFound:
    """``scores`` of a slope's cells, NaN without data, and ``probabilities`` (3, columns, rows) of background, uplift
    and subsidence; without data all is background.
    """

    scores: Scores
    probabilities: Float32


class ReliefModel:
    """The network on rasters of relief ready to run, as the parameters ask for it.

    Raises:
        InputError: as ``network.ScreeningModel``, but that a processor needs no torch; or the description's calibration
            is none.
    """

    def __init__(self, parameters: ScreeningParameters) -> None:
        self.path, pin = (Path(parameters.weights), None) if parameters.weights else shipped_relief()
        self.network, self.description, self.computed = _network(self.path, pin, parameters.device)
        self.scale, self.shift = calibration_of(self.description)
        self.threads = int(given(parameters.threads) or min(processors(), MAX_THREADS))

    def facts(self) -> dict[str, Any]:
        """What the run record says of the model."""
        return {
            "name": "relief",
            "kind": self.description["kind"],
            "sha256": self.description["sha256"],
            "parameters": self.description.get("parameters"),
            "calibration": {"scale": self.scale, "shift": self.shift},
            "threads": self.threads,
            **self.computed,
        }

    def found(self, cells: CellHeights, progress: Progress) -> ReliefFound:
        """Scores and probabilities of the cells of a slope's raster.

        Raises:
            EngineError: memory ran out.
            InputError: the network's answers are no numbers.
        """
        with memory_reported():
            relief = relief_channels(cells)
            # one thread a tile: others of this process work on other tiles, and sums would depend on their number
            with one_blas_thread(), one_torch_thread():
                logits = raster_logits(self.network, relief.channels, threads=self.threads, progress=progress)
        refuse_senseless(logits, self.path)
        up, down = (np.where(relief.covered, odds, np.nan) for odds in log_odds(logits))
        probabilities = calibrated_logits(logits, self.scale, self.shift)
        nothing = np.array([1.0, 0.0, 0.0], dtype=np.float32)[:, None, None]
        return ReliefFound(relative_scores(up, down, cells.cell), np.where(relief.covered, probabilities, nothing))


def _network(path: Path, pin: str | None, device: str) -> tuple[ReliefNetwork, dict[str, Any], dict[str, str]]:
    """The network, its description, and what computes it: numpy on a processor, else torch."""
    otherwise = "or use --screening-method filter"
    if device == "cpu":
        require_libraries("Screening by relief", otherwise, ["safetensors"])
        return *load_plain_unet(path, pin), {"device": "cpu", "numpy": np.__version__}
    require_libraries(f"Screening by relief with --device {device}", otherwise)
    import torch

    from ..network.unet import load_unet

    chosen = chosen_device(device)
    network, description = load_unet(path, pin)
    return network.to(chosen), description, {"device": str(chosen), "torch": torch.__version__}


def calibrated_logits(logits: Float32, scale: float, shift: float) -> Float32:
    """Probabilities (3, columns, rows) of logits of background, uplift and subsidence: those of the hazards over that
    of the background times ``scale`` plus ``shift`` (Platt 1999, Probabilistic outputs for support vector machines).
    """
    hazards = scale * (logits[1:] - logits[:1]) + shift
    return np.asarray(softmax(np.concatenate([np.zeros_like(logits[:1]), hazards]), axis=0), dtype=np.float32)


def calibration_of(description: Mapping[str, Any]) -> tuple[float, float]:
    """Scale and shift that a model's description holds; 1 and 0 where it has none.

    Raises:
        InputError: what it holds is no calibration.
    """
    stated = description.get("calibration", {})
    values: list[NDArray[np.floating] | Any] = [None, None]
    if isinstance(stated, Mapping):
        values = [stated.get("scale", 1.0), stated.get("shift", 0.0)]
    if any(isinstance(v, bool) or not isinstance(v, (int, float)) or not math.isfinite(v) for v in values) or (
        values[0] <= 0
    ):
        raise InputError(f"The weights' description has the calibration {quoted(stated)}; restore it, or train again.")
    return float(values[0]), float(values[1])
