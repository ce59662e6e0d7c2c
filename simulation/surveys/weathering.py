"""What happens to the whole ground between two surveys: micro relief is renewed, short grass grows."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy import fft

from ...engine.core.arrays import Float
from ..fields import HeightField, power_law_field
from .scene import TURF_STEP_M, Relief, Scene, relief_values

_PATCHES_M = (2.0, 8.0)
"""Shortest and longest wavelength of the growth of grass: patches of about 2 m."""


def eroded(scene: Scene, wavelength: float, relief: Relief, rng: np.random.Generator) -> Scene:
    """The scene after part of its relief was worn away and replaced by new relief of the same kind.

    Of relief of ``wavelength`` m half remains, of a length l the share 2^-(wavelength / l)²: what diffusion along a
    slope leaves in one time, with fresh relief of the same spectrum (``relief``) in place of what is lost, so that
    roughness stays what it was. 0 leaves all.
    """
    if wavelength == 0:
        return scene
    base = scene.base
    _, v = base.nodes()
    shape = (base.values.shape[0], base.values.shape[1])
    plain = scene.profile(v)[:, None]
    fresh = relief_values(relief, shape, base.step, v, rng)
    kept = remaining(shape, base.step, wavelength)
    values = _filtered(base.values - plain, kept) + _filtered(fresh, np.sqrt(1.0 - kept**2)) + plain
    return replace(scene, base=replace(base, values=np.ascontiguousarray(values)))


def remaining(shape: tuple[int, int], step: float, wavelength: float) -> Float:
    """Share of the relief that remains (rows, columns), by the numbers of the cosines of a field's transform."""
    rows, columns = (np.arange(n) / (2 * n * step) for n in shape)
    return np.exp2(-((wavelength * rows[:, None]) ** 2)) * np.exp2(-((wavelength * columns[None, :]) ** 2))


def _filtered(values: Float, share: Float) -> Float:
    # Cosines reflect the field at its edges, where a Fourier transform would join opposite ones.
    coefficients = fft.dctn(values, norm="ortho")
    coefficients *= share
    return np.asarray(fft.idctn(coefficients, norm="ortho"))


def grown(scene: Scene, growth: float, rng: np.random.Generator) -> Scene:
    """The scene with short grass that is ``growth`` m higher in the mean, 0 to twice as much, in patches of 2 m."""
    if growth == 0:
        return scene
    turf = scene.turf
    shape = (turf.values.shape[0], turf.values.shape[1])
    patches = power_law_field(shape, TURF_STEP_M, 2.0, *_PATCHES_M, rng)
    _, v = turf.nodes()
    values = turf.values + growth * np.clip(1.0 + 0.5 * patches, 0.0, 2.0) * (v > 0)[:, None]
    return replace(scene, turf=HeightField(turf.u0, turf.v0, turf.step, values))
