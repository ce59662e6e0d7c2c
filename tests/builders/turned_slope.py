"""A strip of sparse ground that lies oblique to its grid, as two surveys see it, with change and plants."""

from __future__ import annotations

import numpy as np
from slopewatch.engine.pointcloud.plant_cover import PlantCover

Survey = tuple[np.ndarray, PlantCover]


def turned_slope(length: float, *, width: float = 12.0, density: float = 40.0) -> tuple[Survey, Survey]:
    """Points (n, 3) of both surveys and the plants over them.

    Every 10 m lies a hollow of 0.3 m in the second; shrubs leave one point in six, and grass grew on a third of it.
    """
    return _survey(1, length, width, density, later=False), _survey(2, length, width, density, later=True)


def _survey(seed: int, length: float, width: float, density: float, *, later: bool) -> Survey:
    rng = np.random.default_rng(seed)
    u, v = rng.uniform(0, length, int(density * length * width)), rng.uniform(0, width, int(density * length * width))
    shrub = (np.sin(2.1 * u) * np.sin(1.7 * v)) > 0.75
    seen = ~shrub | (rng.random(u.size) < 1 / 6)
    u, v, shrub = u[seen], v[seen], shrub[seen]
    z = 100 + 0.6 * v + 0.2 * np.sin(u / 3) + rng.normal(0, 0.02, u.size)
    grass = (u % 30.0) > 20.0
    if later:
        z -= 0.3 * np.exp(-(((u % 10.0 - 5.0) / 1.2) ** 2) - ((v - width / 2) / 1.2) ** 2)
    z += np.where(grass, 0.05 if later else 0.02, 0.0)
    xyz = np.column_stack([500.0 + 0.8 * u - 0.6 * v, 900.0 + 0.6 * u + 0.8 * v, z])
    height = np.where(grass, 0.35 if later else 0.15, 0.01) + 0.3 * shrub
    return xyz, PlantCover(np.where(grass | shrub, 0.02, 0.0), height)
