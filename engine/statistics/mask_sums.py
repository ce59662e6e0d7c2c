"""Sums of cells over a mask about each of them."""

from __future__ import annotations

import numpy as np
from scipy.fft import irfft2, next_fast_len, rfft2

from ..core.arrays import Bool, Float


def mask_sums(values: Float, mask: Bool) -> Float:
    """Sums of values (rows, columns, k) over a mask of odd sides about each cell; 0 beyond the rows and columns.

    By the fast Fourier transform, so errors are those of rounding of the largest sum.
    """
    sides = tuple(next_fast_len(n + m - 1, real=True) for n, m in zip(values.shape, mask.shape, strict=False))
    over = rfft2(mask[::-1, ::-1].astype(np.float64), sides)
    sums = irfft2(rfft2(values, sides, axes=(0, 1)) * over[..., np.newaxis], sides, axes=(0, 1))
    middle = tuple(slice(m // 2, m // 2 + n) for n, m in zip(values.shape, mask.shape, strict=False))
    return np.asarray(sums[middle])
