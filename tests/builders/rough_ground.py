"""Rough ground with a known spectrum, sampled twice at places of its own, without the project's simulation."""

from __future__ import annotations

import numpy as np
from scipy import ndimage

SPACING_M = 0.05


def relief(side: float, roughness: float, seed: int) -> np.ndarray:
    """(n, n) heights with a spectrum of wavenumber^-3 and a standard deviation of ``roughness`` metres."""
    count = int(side / SPACING_M)
    rng = np.random.default_rng(seed)
    k = np.hypot(*np.meshgrid(np.fft.fftfreq(count), np.fft.rfftfreq(count), indexing="ij"))
    k[0, 0] = np.inf
    heights = np.fft.irfft2(np.fft.rfft2(rng.normal(size=(count, count))) * k**-1.5, s=(count, count))
    return heights * roughness / heights.std()


def sampled(
    heights: np.ndarray, density: float, noise: float, seed: int, dip_deg: float = 35.0, gaps: float = 0.0
) -> np.ndarray:
    """(n, 3) points on the relief over a plane that dips to the east; ``gaps`` is the share of it without points."""
    rng = np.random.default_rng(seed)
    side = len(heights) * SPACING_M
    plane = rng.uniform(0.5, side - 1.0, size=(int(density * side**2), 2))
    if gaps:
        holes = ndimage.gaussian_filter(np.random.default_rng(99).normal(size=heights.shape), 12)
        index = (plane / SPACING_M).astype(int)
        plane = plane[holes[index[:, 0], index[:, 1]] > np.quantile(holes, gaps)]
    above = ndimage.map_coordinates(heights, plane.T / SPACING_M, order=1) + rng.normal(0, noise, len(plane))
    return in_the_map(np.column_stack([plane, above]), dip_deg)


def axes(dip_deg: float = 35.0) -> np.ndarray:
    """(3, 3) down the dip, across it and normal to it, row by row."""
    c, s = np.cos(np.radians(dip_deg)), np.sin(np.radians(dip_deg))
    return np.array([[c, 0.0, -s], [0.0, 1.0, 0.0], [s, 0.0, c]])


def in_the_map(plane: np.ndarray, dip_deg: float = 35.0) -> np.ndarray:
    return plane @ axes(dip_deg) + np.array([500_000.0, 3_000_000.0, 100.0])
