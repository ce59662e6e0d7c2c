"""Screening without learning: a point is a hazard if it lies far enough above or below the trend around it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.special import expit

from .configuration import ModelConfiguration
from .preparation import prepare_cloud

Float = NDArray[np.float64]
Float32 = NDArray[np.float32]


def residual_probabilities(
    xyz: Float,
    *,
    threshold: float = 0.08,
    trend: tuple[float, float] = (4.0, 4.0),
    spread: float = 0.02,
    voxel: float = 0.12,
    seed: int = 0,
) -> Float32:
    """(n, 3) memberships of background, uplift and subsidence, the largest of which is the class.

    A voxel is uplift where it lies more than ``threshold`` m above its robust ``trend`` (reach along and up the
    slope, m), subsidence where it lies as far below; ``spread`` (m) says how quickly the membership changes about the
    threshold. It is no calibrated probability.

    Raises:
        InputError: the cloud has too few points or its plane cannot be found.
    """
    configuration = ModelConfiguration(name="residual", voxel=voxel, trends=(trend,))
    cloud = prepare_cloud(xyz, configuration, seed)
    height = cloud.residuals[:, 0].astype(np.float64)
    up, down = (expit((sign * height - threshold) / spread) for sign in (1.0, -1.0))
    result = np.stack([np.maximum(1.0 - up - down, 0.0), up, down], axis=1)
    result /= result.sum(axis=1, keepdims=True)
    return result.astype(np.float32)[cloud.voxels.inverse]
