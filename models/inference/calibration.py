"""Temperature scaling: one number that makes a model's probabilities as sure as they are right.

Guo et al. 2017, On calibration of modern neural networks (arXiv:1706.04599), section 4.2, on probabilities: these are
averages over windows and rotations, whose logarithms take the place of the logits. The temperature changes no label.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar

from ...engine.core.arrays import Float
from ...engine.core.errors import InputError
from ...engine.core.messages import quoted
from .calibration_bins import calibration_bins, calibration_error

_MIN_PROBABILITY = 1e-6
RANGE = (0.05, 20.0)
"""Temperatures that are looked for; 1 changes nothing, larger is less sure."""


@dataclass(frozen=True)
class Calibration:
    """A fitted temperature, with mean negative log-likelihood and expected calibration error before and after it on
    the points that it was fitted on, and how many these are.
    """

    temperature: float
    nll_before: float
    nll_after: float
    error_before: float
    error_after: float
    points: int

    def summary(self) -> dict[str, Any]:
        """By name, rounded, ready for JSON."""
        return {name: round(value, 5) if isinstance(value, float) else value for name, value in asdict(self).items()}


def fit_temperature(probabilities: NDArray[np.floating], labels: NDArray[np.integer]) -> Calibration:
    """The temperature with the least negative log-likelihood.

    Args:
        probabilities: (n, classes) of points that the model was not trained on.
        labels: (n,) their classes.

    Raises:
        InputError: there are no points.
    """
    if not len(labels):
        raise InputError("There are no held-out points to calibrate on; give more labelled files.")
    logarithms = np.log(np.maximum(probabilities, _MIN_PROBABILITY).astype(np.float64))
    own = np.arange(len(labels))

    def loss(sharpness: float) -> float:
        # Convex in 1 / temperature: a sum of log-sum-exp of linear functions.
        scaled = sharpness * logarithms
        highest = scaled.max(axis=1)
        return float((highest + np.log(np.exp(scaled - highest[:, None]).sum(axis=1)) - scaled[own, labels]).mean())

    found = minimize_scalar(loss, bounds=(1 / RANGE[1], 1 / RANGE[0]), method="bounded", options={"xatol": 1e-6})
    temperature = 1.0 / float(found.x)
    scaled, classes = apply_temperature(probabilities, temperature), labels.astype(np.uint8)
    return Calibration(
        temperature,
        loss(1.0),
        loss(1.0 / temperature),
        calibration_error(calibration_bins(classes, probabilities)),
        calibration_error(calibration_bins(classes, scaled)),
        len(labels),
    )


def apply_temperature(probabilities: NDArray[np.floating], temperature: float) -> Float:
    """(n, classes) probabilities at another temperature; the most probable class stays."""
    scaled = np.log(np.maximum(probabilities, _MIN_PROBABILITY).astype(np.float64)) / temperature
    scaled -= scaled.max(axis=1, keepdims=True)
    np.exp(scaled, out=scaled)
    return np.asarray(scaled / scaled.sum(axis=1, keepdims=True))


def temperature_of(description: Mapping[str, Any]) -> float:
    """The temperature that a model's description (``ModelFile.metadata``) holds; 1 where it has none.

    Raises:
        InputError: what it holds is no temperature.
    """
    metrics = description.get("metrics")
    calibration = metrics.get("calibration") if isinstance(metrics, Mapping) else None
    value = calibration.get("temperature", 1.0) if isinstance(calibration, Mapping) else 1.0
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not (math.isfinite(value) and value > 0):
        raise InputError(f"The weights' description has the temperature {quoted(value)}; restore it, or train again.")
    return float(value)
