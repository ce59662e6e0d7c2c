"""Erosion renews short relief and keeps the roughness; grass grows in patches."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from slopewatch.simulation.surveys.weathering import eroded, grown
from slopewatch.tests.builders.moving_ground import RELIEF, bare_slope

WAVELENGTH_M = 0.5


@pytest.fixture(scope="module")
def rest():
    return bare_slope(3)


def spectra(before, after):
    """Radial mean of power before and after, and the share in common, by wavelength (m), of a square of the face."""
    base = before.base
    _, v = base.nodes()
    inside = np.flatnonzero((v > 1.0) & (v < 18.0))
    side = inside.size
    fields = []
    for scene in (before, after):
        residual = (scene.base.values - scene.profile(v)[:, None])[inside][:, :side]
        window = np.hanning(side)[:, None] * np.hanning(side)[None, :]
        fields.append(np.fft.rfft2((residual - residual.mean()) * window))
    frequency = np.hypot(np.fft.fftfreq(side, base.step)[:, None], np.fft.rfftfreq(side, base.step)[None, :])
    edges = np.array([0.2, 0.35, 0.6, 1.0, 1.7, 2.4])
    rows = []
    for low, high in pairwise(edges):
        ring = (frequency >= low) & (frequency < high)
        one, two = fields[0][ring], fields[1][ring]
        power = (np.abs(one) ** 2).mean(), (np.abs(two) ** 2).mean()
        common = (one * two.conj()).real.mean() / np.sqrt(power[0] * power[1])
        expected = np.exp2(-((WAVELENGTH_M * frequency[ring]) ** 2))
        expected = (np.abs(one) ** 2 * expected).sum() / (np.abs(one) ** 2).sum()
        rows.append((*power, common, expected, np.sqrt(low * high)))
    return np.array(rows)


def test_erosion_renews_short_relief_and_keeps_its_spectrum(rest):
    after = eroded(rest, WAVELENGTH_M, RELIEF, np.random.default_rng(9))
    before_power, after_power, common, expected, frequency = spectra(rest, after).T
    assert common == pytest.approx(expected, abs=0.08)
    assert common[0] > 0.9
    assert common[-1] < 0.6
    assert after_power / before_power == pytest.approx(1.0, abs=0.2)
    # Both fall with the third power of the wavenumber between 0.4 and 8 m of wavelength (micro relief is shorter).
    for power in (before_power, after_power):
        slope = np.polyfit(np.log(frequency[:3]), np.log(power[:3]), 1)[0]
        assert slope == pytest.approx(-3.0, abs=0.35)


def test_erosion_adds_up_and_leaves_the_face_in_its_place(rest):
    once = eroded(rest, WAVELENGTH_M, RELIEF, np.random.default_rng(9))
    twice = eroded(once, WAVELENGTH_M, RELIEF, np.random.default_rng(10))
    one, two = spectra(rest, once)[:, 2], spectra(rest, twice)[:, 2]
    assert two[:3] == pytest.approx(one[:3] ** 2, abs=0.08)
    change = twice.base.values - rest.base.values
    assert abs(change.mean()) < 0.002
    assert change.std() > 0.01
    assert eroded(rest, 0.0, RELIEF, np.random.default_rng(9)) is rest


def test_grass_grows_by_its_mean_in_patches_and_not_on_the_road(rest):
    after = grown(rest, 0.02, np.random.default_rng(4))
    _, v = rest.turf.nodes()
    growth = after.turf.values - rest.turf.values
    assert not growth[v <= 0].any()
    slope = growth[v > 0]
    assert slope.mean() == pytest.approx(0.02, rel=0.1)
    assert slope.std() == pytest.approx(0.01, rel=0.2)
    assert 0 <= slope.min() < slope.max() <= 0.04
    # Half a metre away grass is alike, six metres away it is not.
    alike = [np.corrcoef(slope[:, :-lag].ravel(), slope[:, lag:].ravel())[0, 1] for lag in (2, 24)]
    assert alike[0] > 0.6
    assert abs(alike[1]) < 0.25
    assert grown(rest, 0.0, np.random.default_rng(4)) is rest
