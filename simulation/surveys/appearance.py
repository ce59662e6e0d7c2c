"""Colours and intensities that look like a survey's: asphalt, soil, grass and leaves in the light of one sun."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ...engine.core.arrays import Float
from ..sources import LEAVES, TURF
from .scene import Scene

SUN = np.array([-0.35, -0.45, 0.82])
ASPHALT = np.array([112.0, 112.0, 116.0])
SOIL = np.array([150.0, 122.0, 92.0])
ROCK = np.array([142.0, 136.0, 126.0])
GRASS = np.array([120.0, 132.0, 70.0])
LEAF = np.array([72.0, 110.0, 48.0])


def colours(
    scene: Scene, place: Float, direction: Float, source: NDArray[np.uint8], above: Float, rng: np.random.Generator
) -> tuple[NDArray[np.uint8], Float]:
    """(n, 3) RGB, and the cosine of the angle of incidence (n,) of echoes at local ``place`` (3, n).

    Leaves are darker low in the crown; the ground is shaded by its own relief.
    """
    u, v, _ = place
    near = 0.15
    du = (scene.height(u + near, v) - scene.height(u - near, v)) / (2 * near)
    dv = (scene.height(u, v + near) - scene.height(u, v - near)) / (2 * near)
    length = np.sqrt(du**2 + dv**2 + 1.0)
    normal = np.stack([-du, -dv, np.ones_like(du)]) / length
    incidence = np.clip(-(normal * direction).sum(axis=0), 0.05, 1.0)
    sun = SUN / np.linalg.norm(SUN)
    light = 0.45 + 0.55 * np.clip(sun @ normal, 0.0, 1.0)
    # Soil and rock alternate with the relief, which needs no further field.
    relief = np.clip(0.5 + 4.0 * (place[2] - scene.profile(v)), 0.0, 1.0)
    base = SOIL[:, None] * (1 - relief) + ROCK[:, None] * relief
    grass = np.clip(scene.grass(u, v) / 0.08, 0.0, 0.8)
    base = base * (1 - grass) + GRASS[:, None] * grass
    base = np.where(v < 0, ASPHALT[:, None], base)
    base = np.where(source == TURF, GRASS[:, None], base) * light
    leaves = LEAF[:, None] * (0.55 + 0.6 * np.clip(above / 3.0, 0.0, 1.0))
    rgb = np.where(source == LEAVES, leaves, base) * rng.normal(1.0, 0.07, len(u))
    rgb += rng.normal(0.0, 4.0, rgb.shape)
    return np.ascontiguousarray(np.clip(rgb, 0, 255).T.astype(np.uint8)), incidence


def intensities(
    source: NDArray[np.uint8], energy: Float, incidence: Float, rng: np.random.Generator
) -> NDArray[np.uint16]:
    """16-bit intensity (n,): reflectance in the near infrared times energy, for ground times cos(incidence)."""
    reflectance = np.select([source == LEAVES, source == TURF], [0.45, 0.40], 0.30)
    facing = np.where(source == LEAVES, rng.uniform(0.4, 1.0, len(source)), incidence)
    value = 42_000.0 * reflectance * energy * facing * rng.normal(1.0, 0.08, len(source))
    return np.clip(value, 1, 65_535).astype(np.uint16)
