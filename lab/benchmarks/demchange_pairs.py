"""Simulated pairs of elevation models: known change, bias, shift, and errors of a known covariance."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import fft

from ...engine.core.arrays import Bool, Float
from ...engine.elevation_models.terrain import terrain_of
from ...engine.statistics.variogram import VariogramModel
from .volumes import correlated_field

SIDE, CELL_M, MARGIN = 300, 1.0, 40  # cells
ERRORS = {
    "alike over 6 and 40 m": VariogramModel(0.1, (0.5, 0.4), (6.0, 40.0)),
    "alike over 10 and 120 m": VariogramModel(0.0, (0.6, 0.4), (10.0, 120.0)),
}
_BIAS_M, _SHIFT_M = 0.3, 0.7  # standard deviation of the bias, largest shift
_RELIEF_M, _ROUGH = 9.0, 3.4  # standard deviation of the heights, exponent of their spectrum
_LOWEST_M, _HIGHEST_M = 0.05, 1.0  # mean change of a place
_SIDES = (15, 60)  # cells along the sides of a changed place


@dataclass(frozen=True)
class SimulatedModels:
    """Heights (rows, columns), metres, and what is true of them.

    Attributes:
        places: windows of the grid that have changed.
        volumes: their true net volumes, m³.
        stable: cells that have not changed, some cells away from those that have.
        offset: true shift east, north, and bias of the second model, metres.
    """

    first: Float
    second: Float
    places: tuple[tuple[slice, slice], ...]
    volumes: tuple[float, ...]
    stable: Bool
    offset: tuple[float, float, float]


def simulated_models(seed: int, model: VariogramModel) -> SimulatedModels:
    """Hills whose errors grow with slope and curvature; three places lowered or raised, one of them by hardly more
    than the errors.
    """
    rng = np.random.default_rng([seed, 17])
    size = SIDE + 2 * MARGIN
    spectrum = _hills(size, rng)
    east, north = rng.uniform(-_SHIFT_M, _SHIFT_M, 2)
    bias = _BIAS_M * rng.standard_normal()
    ground = _at(spectrum, 0.0, 0.0)
    terrain = terrain_of(ground, CELL_M)
    inner = np.s_[MARGIN : MARGIN + SIDE, MARGIN : MARGIN + SIDE]
    sigma = (0.03 + 0.002 * terrain.slope + 0.15 * np.minimum(terrain.curvature, 0.3))[inner]
    change, places = _change(rng)
    heights = [ground[inner], _at(spectrum, east, north)[inner] + change + bias]
    first, second = (h + sigma * correlated_field((SIDE, SIDE), CELL_M, model, rng) for h in heights)
    changed = np.zeros((SIDE, SIDE), dtype=bool)
    for rows, columns in places:
        changed[rows.start - 3 : rows.stop + 3, columns.start - 3 : columns.stop + 3] = True
    volumes = tuple(float(change[place].sum()) * CELL_M**2 for place in places)
    return SimulatedModels(first, second, places, volumes, ~changed, (float(east), float(north), float(bias)))


def _hills(size: int, rng: np.random.Generator) -> Float:
    """Spectrum of periodic hills that are smooth over some cells."""
    frequency = np.hypot(np.fft.fftfreq(size)[:, None], np.fft.rfftfreq(size))
    frequency[0, 0] = np.inf
    amplitude = frequency ** (-_ROUGH / 2) * np.exp(-((frequency / 0.12) ** 2))
    spectrum = fft.rfft2(rng.standard_normal((size, size))) * amplitude
    spread = float(np.std(fft.irfft2(spectrum, (size, size))))
    return np.asarray(spectrum * (_RELIEF_M / spread))


def _at(spectrum: Float, east: float, north: float) -> Float:
    """The hills moved by so many metres, exactly."""
    size = len(spectrum)
    turn = np.fft.rfftfreq(size) * east / CELL_M - np.fft.fftfreq(size)[:, None] * north / CELL_M
    return np.asarray(fft.irfft2(spectrum * np.exp(-2j * np.pi * turn), (size, size)) + 300.0)


def _change(rng: np.random.Generator) -> tuple[Float, tuple[tuple[slice, slice], ...]]:
    change, places = np.zeros((SIDE, SIDE)), []
    # each in a third of the grid, so that none lies upon another
    for third in range(3):
        high, wide = rng.integers(*_SIDES, 2).tolist()
        row = int(rng.integers(10, SIDE - high - 10))
        column = third * (SIDE // 3) + int(rng.integers(5, SIDE // 3 - wide - 5))
        place = slice(row, row + high), slice(column, column + wide)
        shape = np.sin(np.linspace(0, np.pi, high))[:, None] * np.sin(np.linspace(0, np.pi, wide))
        mean = float(np.exp(rng.uniform(np.log(_LOWEST_M), np.log(_HIGHEST_M)))) * rng.choice((-1.0, 1.0))
        change[place] = mean * shape / shape.mean()
        places.append(place)
    return change, tuple(places)
