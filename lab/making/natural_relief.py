"""Relief as natural ground has it: a power law of the wavelength up to the slope's length, rough in places.

Measured on the clouds and elevation models of ``relief_grounds.SITES`` (squares of 36 m on their own plane, Hann's
window), 11 of them with enough ground: the two-dimensional power spectrum falls as k^-3.3 (median) between wavelengths
of 1.2 and 5 m and as k^-4.2 between 5 and 18 m, along a line as k^-2.3 and k^-3.3. The roughness of the scenes ends at
8 m.
Waves of 1.2 to 7 m have a standard deviation of 2 to 10 cm on most. Their amplitude changes from place to place: a
multiplicative cascade (Schertzer and Lovejoy 1987, doi:10.1029/JD092iD08p09693), in which each octave inherits the
amplification of the longer ones, gives the heavy tails that real relief has at every scale.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import map_coordinates

from ...engine.core.arrays import Float
from ...simulation.fields import power_law_field
from ...simulation.hazard_scenes.styles import log_uniform

REFERENCE_M = 7.0
"""The amount of relief is the standard deviation of its waves up to this length."""
EXPONENT = (3.4, 4.6)
"""Of the two-dimensional power spectrum; uniform."""
AMOUNT = (0.025, 0.16)
"""Log-uniform, m: barely seen to broken by gullies."""
LONGEST_M = 20.0
"""The longest wave is log-uniform from here to the slope's length."""
SHORTEST_M = 0.6
CONTRAST = (0.4, 0.75)
"""Standard deviation of the logarithm of an octave's amplification by the next longer one; uniform."""
HIDING_WAVE_M = 3.0
"""Waves up to this length hide hazards of their size; longer ones are ground that the hazards lie on."""
_STEP_M = 0.15
_NODES_A_WAVE = 8.0
_OCTAVE_PART = 1.2
"""By which an octave's limits are moved outwards, so that its soft ends meet its neighbours'."""


@dataclass(frozen=True)
class ReliefLaw:
    """``exponent`` of the two-dimensional power spectrum, ``amount`` (m) of waves up to ``REFERENCE_M``, ``longest``
    wave (m), ``contrast`` between places (see ``CONTRAST``).
    """

    exponent: float
    amount: float
    longest: float
    contrast: float

    def deviation(self, longest: float) -> float:
        """Standard deviation (m) of the waves up to ``longest`` m: the integral of k^-exponent over the plane."""
        power = self.exponent - 2.0
        up_to, reference = (
            wave**power - SHORTEST_M**power for wave in (min(longest, self.longest), min(REFERENCE_M, self.longest))
        )
        return self.amount * math.sqrt(max(up_to, 0.0) / reference)


@dataclass(frozen=True)
class ReliefHeights:
    """``height`` (n,) m, and ``hiding`` (n,) m: the local standard deviation of waves up to ``HIDING_WAVE_M``."""

    height: Float
    hiding: Float


def draw_law(length: float, rng: np.random.Generator) -> ReliefLaw:
    """A law from the measured ranges for a slope of ``length`` m."""
    return ReliefLaw(
        float(rng.uniform(*EXPONENT)),
        log_uniform(AMOUNT, rng),
        log_uniform((LONGEST_M, max(length, LONGEST_M)), rng),
        float(rng.uniform(*CONTRAST)),
    )


def relief_heights(xy: Float, law: ReliefLaw, rng: np.random.Generator) -> ReliefHeights:
    """Relief at points (n, 2) m of the slope's plane."""
    low = xy.min(axis=0)
    size = np.ptp(xy, axis=0)
    height, hiding, log_gain = (np.zeros(len(xy)) for _ in range(3))
    wave = law.longest
    while wave > SHORTEST_M:
        shorter = max(wave / 2.0, SHORTEST_M)
        deviation = math.sqrt(max(law.deviation(wave) ** 2 - law.deviation(shorter) ** 2, 0.0))
        gain = np.exp(log_gain)
        height += deviation * gain * _octave(xy - low, size, (shorter, wave), law.exponent, rng)
        short = law.deviation(min(wave, HIDING_WAVE_M)) ** 2 - law.deviation(min(shorter, HIDING_WAVE_M)) ** 2
        hiding += short * gain**2
        # The mean square of the amplification stays 1: E exp(2 (s g - s^2)) = 1 for normal g.
        log_gain += law.contrast * _octave(xy - low, size, (shorter, wave), 2.0, rng) - law.contrast**2
        wave = shorter
    return ReliefHeights(height, np.sqrt(hiding))


def _octave(xy: Float, size: Float, waves: tuple[float, float], exponent: float, rng: np.random.Generator) -> Float:
    """Waves (n,) of unit standard deviation between two lengths (m), on a lattice as fine as they need."""
    step = max(_STEP_M, waves[0] / _NODES_A_WAVE)
    rows, columns = (int(n) for n in np.ceil(size / step).astype(int) + 4)
    field = power_law_field((rows, columns), step, exponent, waves[0] / _OCTAVE_PART, waves[1] * _OCTAVE_PART, rng)
    return np.asarray(map_coordinates(field, (xy / step + 1.0).T, order=3, mode="nearest"))
