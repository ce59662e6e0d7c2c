"""Cheap pairs for displacement vectors: bare relief that stands still; smooth ground on which objects come and go;
furrows.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from ...engine.core.arrays import Float
from ...simulation.surveys.scene import Relief, relief_values

SIDE_M, _STEP_M = 26.0, 0.05
_DIP_DEG, _NOISE_M, _GAPS = 39.0, 0.02, 0.35
_ORIGIN = np.array([500_000.0, 3_000_000.0, 100.0])
_LINES_M = 0.12  # between scan lines
_FURROWED_M = 20.0
_RIDGES_M, _FAINT_M = (0.01, 0.12), 0.012  # standard deviations: of the ridges, least and largest; of the rest, at most
_WINDING_M = 0.4  # standard deviation of the ridges' place, at most


def bare_pair(seed: int, points_per_m2: float) -> tuple[Float, Float]:
    """Two surveys (n, 3) of the demo's relief without plants, with gaps: a third of the ground has no points.

    ``points_per_m2`` are of the map, where there are points; 2 cm of noise.
    """
    rng = np.random.default_rng((seed, 17))
    count = int(SIDE_M / _STEP_M) + 1
    values = relief_values(Relief(), (count, count), _STEP_M, np.full(count, 10.0), rng)
    holes = ndimage.gaussian_filter(rng.normal(size=values.shape), 12)
    seen = holes > np.quantile(holes, _GAPS)
    found = []
    for _ in range(2):
        flat = rng.uniform(0.5, SIDE_M - 0.5, size=(int(points_per_m2 * np.cos(np.radians(_DIP_DEG)) * SIDE_M**2), 2))
        flat = flat[ndimage.map_coordinates(seen.astype(float), flat.T / _STEP_M, order=0) > 0.5]
        found.append(_in_the_map(flat, ndimage.map_coordinates(values, flat.T / _STEP_M, order=1), rng))
    return found[0], found[1]


def changing_objects(seed: int, points_per_m2: float) -> tuple[Float, Float]:
    """Two surveys (n, 3) of a smooth plane in scan lines: boxes of which a third stays, a third comes and a third goes,
    and a bowl that grows. Nothing moves along the surface.
    """
    rng = np.random.default_rng((seed, 23))
    boxes = np.column_stack([
        rng.uniform(2, SIDE_M - 2, (18, 2)), rng.uniform(0.3, 1.5, (18, 2)), rng.uniform(0.1, 0.6, 18)
    ])  # fmt: skip
    bowl = rng.uniform(6, SIDE_M - 6, 2)
    found = []
    for epoch in range(2):
        count = int(points_per_m2 * np.cos(np.radians(_DIP_DEG)) * SIDE_M**2)
        line = (rng.integers(0, int(SIDE_M / _LINES_M), count) + rng.normal(0, 0.05, count)) * _LINES_M
        flat = np.column_stack([rng.uniform(0, SIDE_M, count), line])
        flat = flat if epoch == 0 else flat[:, ::-1]
        height = -(0.15 + 0.25 * epoch) * np.clip(1 - ((flat - bowl) ** 2).sum(axis=1) / 9.0, 0.0, None)
        for number, (x, y, width, depth, top) in enumerate(boxes):
            if number % 3 != 1 + epoch:
                inside = (np.abs(flat[:, 0] - x) < width) & (np.abs(flat[:, 1] - y) < depth)
                height = np.where(inside, np.maximum(height, top), height)
        found.append(_in_the_map(flat, height, rng))
    return found[0], found[1]


@dataclass(frozen=True)
class Furrows:
    """Two surveys (n, 3) of ridges and furrows, and ``gradient`` (2, rows, columns) of the true ground, as finely
    as the surveys show it, where they have points; else 0.
    """

    first: Float
    later: Float
    gradient: Float

    def across(self, place: Float, radius: float) -> float:
        """Angle of the direction in which the ground within ``radius`` of a ``place`` (2,) rises and falls most."""
        rows, columns = np.indices(self.gradient.shape[1:])
        inside = np.hypot(rows * _STEP_M - place[0], columns * _STEP_M - place[1]) < radius
        part = self.gradient[:, inside]
        part = part - part.mean(axis=1, keepdims=True)
        strongest = np.linalg.eigh(part @ part.T)[1][:, -1]
        return float(np.arctan2(strongest[1], strongest[0]))


def furrowed_pair(seed: int, points_per_m2: float, motion: Float) -> Furrows:
    """Ridges and furrows that wind a little, with faint relief along them, low to high; the later survey is moved by
    ``motion`` (2,) metres down the dip and across it. ``points_per_m2`` are of the slope; 2 cm of noise, a fifth of the
    ground has no points.
    """
    rng = np.random.default_rng((seed, 29))
    count = int(_FURROWED_M / _STEP_M) + 1
    angle = float(rng.uniform(0.0, np.pi))
    u, v = np.meshgrid(*2 * [np.arange(count) * _STEP_M], indexing="ij")
    wind = ndimage.gaussian_filter(rng.normal(size=u.shape), 40)
    across = u * np.cos(angle) + v * np.sin(angle) + wind * rng.uniform(0.0, _WINDING_M) / np.std(wind)
    waves = np.exp(rng.uniform(np.log(0.5), np.log(4.0), 12))
    values = sum(w * np.sin(2 * np.pi * across / w + p) for w, p in zip(waves, rng.uniform(0, 7, 12), strict=True))
    values = values * np.exp(rng.uniform(*np.log(_RIDGES_M))) / np.std(values)
    rough = ndimage.gaussian_filter(rng.normal(size=values.shape), rng.uniform(2.0, 8.0))
    values += rough * rng.uniform(0.0, _FAINT_M) / np.std(rough)
    holes = ndimage.gaussian_filter(rng.normal(size=values.shape), 12)
    seen = (holes > np.quantile(holes, 0.2)).astype(float)
    clouds = []
    for shift in (np.zeros(2), motion):
        flat = rng.uniform(1.0, _FURROWED_M - 1.0, size=(int(points_per_m2 * (_FURROWED_M - 2.0) ** 2), 2))
        flat = flat[ndimage.map_coordinates(seen, flat.T / _STEP_M, order=0) > 0.5]
        height = ndimage.map_coordinates(values, flat.T / _STEP_M, order=1)
        clouds.append(_in_the_map(flat + shift, height, rng))
    kernel = 0.92 / np.sqrt(points_per_m2) / _STEP_M
    gradient = np.stack([ndimage.gaussian_filter(values, kernel, order=o) for o in ((1, 0), (0, 1))])
    return Furrows(clouds[0], clouds[1], gradient * seen)


def on_the_plane(xyz: Float) -> Float:
    """(n, 3) down the dip, across it and along the normal of a scene, metres, of points in the map."""
    return np.asarray((xyz - _ORIGIN) @ _axes().T)


def in_space(motion: Float) -> Float:
    """East, north and up of a motion (3,) down the dip, across it and along the normal of a scene."""
    return np.asarray(motion @ _axes())


def _in_the_map(flat: Float, height: Float, rng: np.random.Generator) -> Float:
    plane = np.column_stack([flat, height + rng.normal(0, _NOISE_M, len(flat))])
    return np.asarray(plane @ _axes() + _ORIGIN)


def _axes() -> Float:
    c, s = np.cos(np.radians(_DIP_DEG)), np.sin(np.radians(_DIP_DEG))
    return np.array([[c, 0.0, -s], [0.0, 1.0, 0.0], [s, 0.0, c]])
