"""Simulated ground made rougher: what a model should not take for hazards on slopes rougher than those it learns from.

The texture is white noise under a Gaussian, which is not how the scenes' own roughness is made. Broken ground is made
of flat pieces with edges, as rock, treads and dumped soil have them; unlike the scenes' landforms none of it repeats.
``natural_relief`` has what both lack: waves of all lengths in the proportions of real ground.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from scipy.ndimage import gaussian_filter, map_coordinates
from scipy.spatial import cKDTree

from ...engine.core.arrays import Float
from ...simulation.hazard_scenes.scenes import SimulatedScene
from ...simulation.hazard_scenes.styles import log_uniform
from .natural_relief import ReliefLaw, draw_law, relief_heights

STEP = 0.1
REACH = (0.15, 1.0)
"""Standard deviation of the Gaussian, m; log-uniform."""
AMOUNT = 0.07
"""Largest standard deviation of a texture, m."""
TEXTURES = 2
ROLLING_SHARE, ROLLING_REACH = 0.4, (1.2, 8.0)
ROLLING_GRADE, MAX_ROLLING_M = (0.02, 0.2), 0.5
"""Of rolling ground: its standard deviation over its reach, log-uniform, and its largest standard deviation, m. That
it grows with the reach is what natural ground has: a spectrum falls with the wave number.
"""
BROKEN_SHARE, PIECE, STRETCH = 0.35, (0.5, 4.0), (1.0, 5.0)
"""Of broken ground: how far its pieces lie apart (m) and how much longer than wide they are, both log-uniform."""
BROKEN_GRADE, MAX_BROKEN_M, BROKEN_PATCH = (0.02, 0.15), 0.12, 6.0
"""Standard deviation of its pieces' heights over their distance, log-uniform, that deviation's limit (m), and the reach
of its patches (m).
"""
LEFT_ALONE = 0.25
"""Share of the scenes that get no texture."""
RELIEF_SHARE = 0.665
"""Of the scenes that are rougher, rolling or broken: 60 % of all then have natural relief, the others stay as smooth
as they are built or have the textures alone.
"""
TEXTURE_KEPT = 0.3
"""Share of the scenes with natural relief that keep the textures, too."""


def rougher(scene: SimulatedScene, rng: np.random.Generator) -> SimulatedScene:
    """The scene with textures added along the normal of its mean plane.

    Points whose displacement is less than twice what the texture adds are not trained on: nobody could recognise them.
    """
    if rng.random() < LEFT_ALONE:
        return scene
    plane = scene.to_plane(scene.xyz)
    added, deviation = np.zeros(len(scene)), 0.0
    for _ in range(TEXTURES):
        reach = log_uniform(REACH, rng)
        amount = rng.uniform(0.0, AMOUNT)
        added += texture(plane[:, :2], reach, amount, rng)
        deviation = math.hypot(deviation, amount)
    normal = scene_normal(scene)
    size = np.abs(scene.displacement)
    hidden = (scene.label > 0) & (size < 2.0 * deviation)
    return replace(scene, xyz=scene.xyz + added[:, None] * normal, ignore=scene.ignore | hidden)


def natural(scene: SimulatedScene, rng: np.random.Generator) -> SimulatedScene:
    """The scene as built, ``textured`` or, on ``RELIEF_SHARE`` of those that would be, with ``natural_relief``."""
    rough = textured(scene, rng)
    if rough is scene or rng.random() >= RELIEF_SHARE:
        return rough
    return with_relief(rough if rng.random() < TEXTURE_KEPT else scene, rng)


def with_relief(scene: SimulatedScene, rng: np.random.Generator, law: ReliefLaw | None = None) -> SimulatedScene:
    """The scene with relief of ``law``, drawn from the measured ranges by default, along the normal of its mean plane.

    Points whose displacement is less than twice what the relief's short waves add at their place are not trained on.
    """
    plane = scene.to_plane(scene.xyz)[:, :2]
    added = relief_heights(plane, law or draw_law(float(np.ptp(plane, axis=0).max()), rng), rng)
    hidden = (scene.label > 0) & (np.abs(scene.displacement) < 2.0 * added.hiding)
    moved = scene.xyz + added.height[:, None] * scene_normal(scene)
    return replace(scene, xyz=moved, ignore=scene.ignore | hidden)


def textured(scene: SimulatedScene, rng: np.random.Generator) -> SimulatedScene:
    """``rougher``, and in addition ``ROLLING_SHARE`` of the scenes roll and ``BROKEN_SHARE`` are broken in pieces, as
    natural ground is; neither is a hazard.
    """
    scene = rougher(scene, rng)
    plane = scene.to_plane(scene.xyz)[:, :2]
    if rng.random() < ROLLING_SHARE:
        reach = log_uniform(ROLLING_REACH, rng)
        heights = texture(plane, reach, min(log_uniform(ROLLING_GRADE, rng) * reach, MAX_ROLLING_M), rng)
        scene = replace(scene, xyz=scene.xyz + heights[:, None] * scene_normal(scene))
    if rng.random() < BROKEN_SHARE:
        apart = log_uniform(PIECE, rng)
        amount = min(log_uniform(BROKEN_GRADE, rng) * apart, MAX_BROKEN_M)
        heights = pieces(plane, apart, log_uniform(STRETCH, rng), amount, rng)
        hidden = (scene.label > 0) & (np.abs(scene.displacement) < 2.0 * float(heights.std()))
        moved = scene.xyz + heights[:, None] * scene_normal(scene)
        scene = replace(scene, xyz=moved, ignore=scene.ignore | hidden)
    return scene


def pieces(xy: Float, apart: float, stretch: float, amount: float, rng: np.random.Generator) -> Float:
    """Heights (n,) at points (n, 2) of ground broken in flat, tilted pieces, in patches that fade out.

    The pieces are the cells of a Voronoi diagram of random places ``apart`` m apart, drawn out to ``stretch`` times
    their width in one direction. Their heights scatter by ``amount`` m within a patch, half of it by their tilt.
    """
    angle = rng.uniform(0.0, math.pi)
    turn = np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
    even = xy @ turn * (math.sqrt(stretch), 1.0 / math.sqrt(stretch))
    low, size = even.min(axis=0), np.ptp(even, axis=0)
    places = low + rng.random((int(np.prod(size / apart)) + 2, 2)) * size
    nearest = cKDTree(places).query(even)[1]
    level = rng.standard_normal(len(places))[nearest]
    lean = rng.standard_normal((len(places), 2))[nearest]
    tilt = np.einsum("ij,ij->i", lean, even - places[nearest])
    heights = level + tilt / max(float(tilt.std()), 1e-12)
    patch = np.clip(0.5 + texture(xy, BROKEN_PATCH, 1.0, rng), 0.0, 1.0)
    return np.asarray(heights * patch * (amount / math.sqrt(2.0)))


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
