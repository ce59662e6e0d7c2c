"""Simulated ground made rougher: what a model should not take for hazards on slopes rougher than those it learns from.

The texture is white noise under a Gaussian, which is not how the scenes' own roughness is made.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter, map_coordinates

from ..simulation.hazard_scenes.scenes import SimulatedScene

Float = NDArray[np.float64]
STEP = 0.1
REACH = (0.15, 1.0)
"""Standard deviation of the Gaussian, m; log-uniform."""
AMOUNT = 0.07
"""Largest standard deviation of a texture, m."""
TEXTURES = 2
ROLLING_SHARE, ROLLING_REACH = 0.4, (1.2, 8.0)
ROLLING_GRADE, ROLLING_LARGEST = (0.02, 0.2), 0.5
"""Of rolling ground: its standard deviation over its reach, log-uniform, and its largest standard deviation, m. That
it grows with the reach is what natural ground has: a spectrum falls with the wave number.
"""
LEFT_ALONE = 0.25
"""Share of the scenes that stay as they are."""


def rougher(scene: SimulatedScene, rng: np.random.Generator) -> SimulatedScene:
    """The scene with textures added along the normal of its mean plane.

    Points whose displacement is less than twice what the texture adds are not trained on: nobody could tell them.
    """
    if rng.random() < LEFT_ALONE:
        return scene
    plane = scene.to_plane(scene.xyz)
    added, deviation = np.zeros(len(scene)), 0.0
    for _ in range(TEXTURES):
        reach = math.exp(rng.uniform(math.log(REACH[0]), math.log(REACH[1])))
        amount = rng.uniform(0.0, AMOUNT)
        added += texture(plane[:, :2], reach, amount, rng)
        deviation = math.hypot(deviation, amount)
    normal = scene_normal(scene)
    size = np.abs(scene.displacement)
    hidden = (scene.label > 0) & (size < 2.0 * deviation)
    return replace(scene, xyz=scene.xyz + added[:, None] * normal, ignore=scene.ignore | hidden)


def natural(scene: SimulatedScene, rng: np.random.Generator) -> SimulatedScene:
    """``rougher``, and ``ROLLING_SHARE`` of the scenes roll besides, as natural ground does; rolling is no hazard."""
    scene = rougher(scene, rng)
    if rng.random() >= ROLLING_SHARE:
        return scene
    reach = math.exp(rng.uniform(math.log(ROLLING_REACH[0]), math.log(ROLLING_REACH[1])))
    grade = math.exp(rng.uniform(math.log(ROLLING_GRADE[0]), math.log(ROLLING_GRADE[1])))
    heights = texture(scene.to_plane(scene.xyz)[:, :2], reach, min(grade * reach, ROLLING_LARGEST), rng)
    return replace(scene, xyz=scene.xyz + heights[:, None] * scene_normal(scene))


def texture(xy: Float, reach: float, amount: float, rng: np.random.Generator) -> Float:
    """Heights (n,) of standard deviation ``amount`` m at points (n, 2), smooth over ``reach`` m."""
    low = xy.min(axis=0)
    shape = np.ceil((xy.max(axis=0) - low) / STEP).astype(int) + 2
    field = gaussian_filter(rng.standard_normal(shape), reach / STEP, mode="wrap")
    field *= amount / max(float(field.std()), 1e-12)
    return np.asarray(map_coordinates(field, ((xy - low) / STEP).T, order=1, mode="nearest"))


def scene_normal(scene: SimulatedScene) -> Float:
    """Unit vector (3,) square to the scene's mean plane, outwards."""
    origin = scene.xyz[:1]
    steps = np.concatenate([origin, origin + np.eye(3)])
    turned = scene.to_plane(steps)
    # Rows of the rotation: what each world axis adds to the plane's third coordinate.
    return np.asarray(turned[1:, 2] - turned[0, 2], dtype=np.float64)
