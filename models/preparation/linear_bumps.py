"""Scores of a bump on a quadratic background by plain least squares on a full lattice: the quick relative of
``bump_filter``.

All windows have the same design, so that its orthonormal columns are kernels of correlations: the bump's height over
its standard error costs eight of them, by Fourier transforms, instead of several rounds in each window. It is not
robust and knows no gaps; a network that reads it learns where to trust it.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from scipy.fft import irfft2, next_fast_len, rfft2

from ...engine.core.arrays import Float
from .bump_filter import UNKNOWNS, BumpDesign

_MIN_SCATTER_M = 0.003


def linear_scores(height: Float, diameter: float, cell: float) -> Float:
    """t scores (columns, rows) of a bump of ``diameter`` m about each cell of a full lattice ``height`` (columns, rows)
    m, positive where the ground stands out. Beyond the rim the nearest cell goes on.
    """
    kernels, cells = _kernels(diameter, cell)
    reach = kernels.shape[1] // 2
    padded = np.pad(height, reach, mode="edge")
    size = [next_fast_len(n + 2 * reach, real=True) for n in padded.shape]
    inner = slice(2 * reach, 2 * reach + height.shape[0]), slice(2 * reach, 2 * reach + height.shape[1])

    def correlate(values: Float, kernel: Float) -> Float:
        # A correlation is a convolution with the kernel turned about its middle.
        turned = rfft2(kernel[..., ::-1, ::-1], size)
        return np.asarray(irfft2(rfft2(values, size) * turned, size)[..., inner[0], inner[1]])

    parts = correlate(padded, kernels)
    squares = correlate(padded**2, cells)
    rest = np.maximum(squares - (parts**2).sum(axis=0), 0.0) / (cells.sum() - UNKNOWNS)
    return np.asarray(parts[-1] / np.sqrt(rest + _MIN_SCATTER_M**2))


@lru_cache(maxsize=16)
def _kernels(diameter: float, cell: float) -> tuple[Float, Float]:
    """Orthonormal columns (7, k, k) of the model on the square about its window, the last what the bump adds to the
    background, and the window's cells (k, k), 1 or 0.
    """
    design = BumpDesign.of(diameter, cell)
    columns, triangle = np.linalg.qr(design.columns.astype(np.float64))
    columns[:, -1] *= np.sign(triangle[-1, -1])
    reach = design.margin
    kernels = np.zeros((UNKNOWNS, 2 * reach + 1, 2 * reach + 1))
    cells = np.zeros(kernels.shape[1:])
    kernels[:, design.di + reach, design.dj + reach] = columns.T
    cells[design.di + reach, design.dj + reach] = 1.0
    return kernels, cells
