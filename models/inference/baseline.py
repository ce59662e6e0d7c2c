"""Screening without learning: a point is a hazard if it lies far enough above or below the trend around it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.special import expit

from ...engine.core.arrays import Float, Float32
from ..configuration import ModelConfiguration
from ..preparation.streaming import prepared_in_voxels

TREND = (4.0, 4.0)
"""Reach (m) along and up the slope of the trend that heights refer to."""
_SPREAD = 0.02  # m


def residual_probabilities(xyz: Float, *, threshold: float = 0.08, voxel: float = 0.12) -> Float32:
    """(n, 3) memberships of background, uplift and subsidence, the largest of which is the class.

    A voxel is uplift where it lies more than ``threshold`` m above its robust trend (``TREND``), subsidence where it
    lies as far below; ``_SPREAD`` says how quickly the membership changes about the threshold. It is no calibrated
    probability.

    Raises:
        InputError: the cloud has too few points or its plane cannot be found.
    """
    cloud, place = prepared_in_voxels(xyz, residual_configuration(voxel))
    return residual_memberships(cloud.residuals[:, 0], threshold)[place]


def residual_configuration(voxel: float = 0.12) -> ModelConfiguration:
    """How a cloud is prepared for the threshold on its height over the trend."""
    return ModelConfiguration(name="residual", voxel=voxel, trends=(TREND,))


def residual_memberships(height: NDArray[np.floating], threshold: float) -> Float32:
    """(m, 3) memberships, as of ``residual_probabilities``, of voxels at ``height`` (m,) over the trend, m."""
    up, down = (expit((sign * height.astype(np.float64) - threshold) / _SPREAD) for sign in (1.0, -1.0))
    result = np.stack([np.maximum(1.0 - up - down, 0.0), up, down], axis=1)
    result /= result.sum(axis=1, keepdims=True)
    return result.astype(np.float32)
