"""What hides a hazard from the screening: hazards of one size put into a simulated cut slope, a small part of it, the
same made rougher, and a real slope.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ...engine.core.arrays import Float
from ...models.preparation.prepare import prepare_cloud, roughness
from ...models.training.recipes import SHIPPED
from ...simulation.hazard_scenes.scenes import build_scene
from ...simulation.hazard_scenes.styles import draw_spec
from ..making.rough_ground import scene_normal, texture
from .real_screening import real_grounds, recall, screenings, trials
from .table import Row

SEED, AREA, DENSITY = 777_777, 3600.0, 14.0
"""Of the slope: as dense as the real one."""
PART = 16.0
TEXTURES = ((0.3, 0.10), (1.0, 0.10), (2.5, 0.15))
"""Reach and standard deviation (m) of what is added."""
AMPLITUDE, DIAMETER, COUNT = 0.5, 3.0, 12
TRENDS = ((2.0, 2.0), (5.0, 5.0))


def grounds() -> dict[str, Float]:
    """Points (n, 3) without hazards, by what they are."""
    scene = build_scene(replace(draw_spec(SEED, "realistic", area=AREA, density=DENSITY), uplift=0.0, subsidence=0.0))
    plane = scene.to_plane(scene.xyz)[:, :2]
    part = (np.abs(plane - np.median(plane, axis=0)) < PART / 2).all(axis=1)
    rng = np.random.default_rng(0)
    found = {"simulated cut slope": scene.xyz, f"{PART:g} m of it": scene.xyz[part]}
    for reach, amount in TEXTURES:
        rough = scene.xyz + texture(plane, reach, amount, rng)[:, None] * scene_normal(scene)
        name = f"rougher by {100 * amount:g} cm with a reach of {reach:g} m"
        found |= {name: rough, f"{PART:g} m of that ({reach:g} m)": rough[part]}
    return found | {ground.name: ground.xyz for ground in real_grounds() if ground.name == "alpine"}


def scatter(xyz: Float) -> Float:
    """Scatter (m) of the ground about each of ``TRENDS``."""
    configuration = replace(SHIPPED.configuration, own_roughness=False, trends=TRENDS)
    return np.asarray(roughness(prepare_cloud(xyz, configuration).residuals), dtype=np.float64)


def rows() -> list[Row]:
    """A row for each ground: its scatter, and how many of the hazards are found."""
    screen = screenings()["network"]
    table = []
    for name, xyz in grounds().items():
        results = trials(xyz, screen, AMPLITUDE, DIAMETER, count=COUNT)
        found, before = recall(results)
        near, far = scatter(xyz)
        table.append(
            Row(
                f"{name}: hazards of {100 * AMPLITUDE:g} cm and {DIAMETER:g} m found",
                f"{100 * found:.0f} % of {len(results)} (shown without them: {100 * before:.0f} %)",
                "",
                f"scatter about trends of {TRENDS[0][0]:g} and {TRENDS[1][0]:g} m: {near:.2f} and {far:.2f} m",
            )
        )
    return table
