"""Random fields and the regular grid that they are kept on."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import fft

from ..engine.core.arrays import Float


@dataclass(frozen=True)
class HeightField:
    """Values at the nodes of a regular grid of the local frame, bilinear between them.

    ``values`` is (rows, columns): row i lies at ``v0 + i * step``, column j at ``u0 + j * step``. Outside, the
    nearest edge counts.
    """

    u0: float
    v0: float
    step: float
    values: Float

    def __call__(self, u: Float, v: Float) -> Float:
        """Value at (u, v), arrays of one shape, m."""
        rows, columns = self.values.shape
        column = np.clip((u - self.u0) / self.step, 0.0, columns - 1.000001)
        row = np.clip((v - self.v0) / self.step, 0.0, rows - 1.000001)
        j = column.astype(np.int64)
        i = row.astype(np.int64)
        column -= j
        row -= i
        flat = self.values.ravel()
        i *= columns
        i += j
        low = flat.take(i)
        low += column * (flat.take(i + 1) - low)
        i += columns
        high = flat.take(i)
        high += column * (flat.take(i + 1) - high)
        low += row * (high - low)
        return low

    def nodes(self) -> tuple[Float, Float]:
        """u of the columns and v of the rows."""
        rows, columns = self.values.shape
        u: Float = self.u0 + self.step * np.arange(columns, dtype=np.float64)
        v: Float = self.v0 + self.step * np.arange(rows, dtype=np.float64)
        return u, v


def power_law_field(
    shape: tuple[int, int],
    step: float,
    exponent: float,
    shortest: float,
    longest: float,
    rng: np.random.Generator,
) -> Float:
    """A Gaussian random field of mean 0 and standard deviation 1 with an isotropic power spectrum k^-exponent.

    Args:
        shape: rows and columns.
        step: distance of the nodes, m.
        exponent: of the two-dimensional power spectral density; about 3 for natural and cut ground.
        shortest, longest: wavelengths of the band, m.
    """
    padded = [fft.next_fast_len(n + int(min(longest / step, n)), real=True) for n in shape]
    spectrum = np.fft.rfft2(rng.standard_normal(padded))
    frequency = np.hypot(np.fft.fftfreq(padded[0], step)[:, None], np.fft.rfftfreq(padded[1], step)[None, :])
    frequency[0, 0] = np.inf
    # Soft ends of the band: a sharp cut rings.
    band = np.exp(-((frequency * shortest) ** 4)) * (1.0 - np.exp(-((frequency * longest) ** 4)))
    band[0, 0] = 0.0
    spectrum *= np.where(np.isfinite(frequency), frequency, 1.0) ** (-exponent / 2.0) * band
    field = np.fft.irfft2(spectrum, s=padded)[: shape[0], : shape[1]]
    deviation = float(field.std())
    if deviation == 0.0:
        return np.zeros(shape)
    return np.ascontiguousarray((field - field.mean()) / deviation)
