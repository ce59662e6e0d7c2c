"""Stated errors of the weakest direction against the true ones, on slopes of which the shape and motion are known."""

from __future__ import annotations

import sys

import numpy as np
from numpy.typing import NDArray

from ..engine.errors import InputError
from ..engine.parameters import RegistrationParameters
from ..engine.registration import register
from ..engine.registration_result import RegistrationResult
from .table import Row

Float = NDArray[np.float64]

DENSITIES = (5, 20, 100)  # points a square metre
NOISES = (0.005, 0.020, 0.050)  # metres
SHAPES = ("face", "bench", "gully")
SIDES = {5: 40.0, 20: 24.0, 100: 12.0}  # metres: the same work everywhere
SEEDS = 8
WITHIN = 1.5
OFFSET = 0.05  # metres


def rows() -> list[Row]:
    """Median and largest ratio of the true error to the stated one, by shape."""
    return [_row(shape, plants) for shape in SHAPES for plants in (False, True)]


def height(shape: str, x: Float, y: Float, side: float) -> Float:
    """Heights (n,) of a 35 degree slope of ``side`` metres: nearly plane, with a bench, or with two gullies."""
    rough = 0.01 * np.sin(1.9 * x + 0.4 * y) + 0.015 * np.sin(0.7 * x - 1.1 * y) + 0.02 * np.sin(0.45 * y)
    z = 0.7 * y + rough
    if shape == "bench":
        z = z - 1.2 * np.clip((y - 0.5 * side) / 3.0, -1.0, 1.0)
    if shape == "gully":
        z = z - 0.8 * np.exp(-(((x - 0.3 * side - 0.1 * y) / 1.2) ** 2))
        z = z - 0.5 * np.exp(-(((x - 0.7 * side + 0.15 * y) / 1.5) ** 2))
    return np.asarray(z)


def survey(shape: str, density: float, noise: float, plants: bool, seed: int) -> Float:
    """Points (n, 3) of one survey; with ``plants`` half of it lies under them: fewer and rougher points, above."""
    rng = np.random.default_rng([seed, int(density), int(1e4 * noise)])
    side = SIDES[int(density)]
    x, y = rng.uniform(0, side, (2, int(density * side**2)))
    z = height(shape, x, y, side) + rng.normal(0, noise, x.size)
    if plants:
        under = np.sin(2 * np.pi * x / 7.0) * np.sin(2 * np.pi * y / 7.0) > 0
        stays = ~under | (rng.random(x.size) < 0.4)
        z = z + np.where(under, rng.exponential(0.03, x.size), 0.0)
        x, y, z = x[stays], y[stays], z[stays]
    return np.column_stack([x, y, z])


def ratio_of(result: RegistrationResult, places: Float, motion: Float) -> tuple[float, float] | None:
    """True and stated error (m) in the weakest direction that is called fixed, for a survey moved by ``motion``."""
    if result.covariance is None or result.weakest is None:
        return None
    middle = places.mean(axis=0)
    away = result.transform.apply(middle[None] + motion)[0] - middle
    spread = result.covariance[3:, 3:]
    values, axes = np.linalg.eigh(spread)
    known = values < (0.25 * RegistrationParameters().maximum_offset) ** 2  # the others are called open
    if not known.any():
        return None
    worst = int(np.flatnonzero(known)[-1])
    return float(abs(away @ axes[:, worst])), float(np.sqrt(values[worst]))


def _row(shape: str, plants: bool) -> Row:
    ratios, worst, open_ones, told = [], "", 0, []
    for density in DENSITIES:
        for noise in NOISES:
            own = []
            for seed in range(SEEDS):
                first, second = (survey(shape, density, noise, plants, 2 * seed + k) for k in (0, 1))
                shift = np.random.default_rng([seed, 9]).normal(0, OFFSET, 3)
                try:
                    result = register(first, second + shift, RegistrationParameters())
                except InputError:
                    open_ones += 1
                    continue
                found = ratio_of(result, second, shift)
                if found is None:
                    open_ones += 1
                    continue
                own.append(found[0] / found[1])
                if own[-1] >= max(ratios, default=0.0):
                    worst = (
                        f"{density} points/m², {1000 * noise:g} mm: {1000 * found[0]:.1f} of {1000 * found[1]:.1f} mm"
                    )
                ratios.append(own[-1])
            if own:
                told.append((float(np.median(own)), f"{density}/m² {1000 * noise:g} mm"))
            print(f"  {shape} {plants} {density} {noise}: {np.round(own, 2)}", file=sys.stderr, flush=True)
    # the median of |x| of a normal distribution is 0.674 of its standard deviation
    middle = float(np.median(ratios)) / 0.674 if ratios else np.nan
    largest = max(told, default=(np.nan, ""))
    return Row(
        f"{shape}{', half under plants' if plants else ''}: true over stated error of the weakest direction",
        f"{middle:.2f} in the middle, largest {max(ratios, default=np.nan):.1f} ({worst})",
        f"within {WITHIN:g} either way, none ten times",
        f"{len(ratios)} surveys, {open_ones} others call all shifts open or are refused; "
        f"worst group {largest[0] / 0.674:.2f} ({largest[1]})",
        bool(1 / WITHIN <= middle <= WITHIN and max(ratios) < 10),
    )
