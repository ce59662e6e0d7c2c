"""Ground of a slope with grass and a bare road, as a ground extraction leaves it under plants."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import laspy
import numpy as np
from pyproj import CRS
from scipy.ndimage import gaussian_filter, map_coordinates
from slopewatch.engine.pointcloud.plant_cover import PlantCover

SIDE = 20.0
DIP = 0.7


@dataclass(frozen=True)
class Grass:
    """One survey's grass: ``height`` m, ground under it ``lifted`` by m, and what its file states as ``error``."""

    height: float = 0.25
    lifted: float = 0.0
    error: float = 0.05


@dataclass(frozen=True)
class Ground:
    """Points (n, 3) with their plants, and which of them are bare."""

    xyz: np.ndarray
    plants: PlantCover
    bare: np.ndarray


def relief() -> np.ndarray:
    """Heights of a rough surface, m, in steps of 5 cm."""
    rng = np.random.default_rng(0)
    weights = ((3, 0.06), (10, 0.12), (30, 0.3))
    return np.sum([w * gaussian_filter(rng.normal(size=(401, 401)), s) * s for s, w in weights], axis=0)


RELIEF = relief()


def grassy_slope(
    seed: int,
    grass: Grass,
    *,
    bare_share: float = 0.15,
    across: bool = False,
    bench: bool = False,
    points: int = 40_000,
    noise: float = 0.01,
    slump: float = 0.0,
) -> Ground:
    """A rough slope of 35 degrees, 20 by 20 m, with a smooth road up it, or ``across`` it; a ``bench`` is level.

    Args:
        slump: metres by which the ground sank within 3 m of (5, 5), under grass.
    """
    rng = np.random.default_rng(seed)
    x, y = rng.uniform(0, SIDE, (2, points))
    bare = np.abs((y if across else x) - SIDE / 2) < bare_share * SIDE / 2
    road = np.full(points, DIP * SIDE / 2) if bench else DIP * y
    z = np.where(bare, road, DIP * y + map_coordinates(RELIEF, [y * 20, x * 20], order=1))
    z -= slump * (np.hypot(x - 5, y - 5) < 3)
    z += rng.normal(0, noise, points) + np.where(bare, 0.0, grass.lifted)
    cover = PlantCover(np.where(bare, 0.0, grass.error), np.where(bare, 0.0, grass.height))
    return Ground(np.column_stack([x, y, z]), cover, bare)


def write_ground(path: Path, ground: Ground, *, dimensions: bool = True) -> Path:
    """A ground cloud by laspy, an independent writer; without ``dimensions`` as other programs leave it."""
    header = laspy.LasHeader(point_format=6, version="1.4")
    header.scales, header.offsets = [0.001] * 3, [500_000, 3_500_000, 0]
    header.add_crs(CRS.from_epsg(32651))
    if dimensions:
        header.add_extra_dims([laspy.ExtraBytesParams(name, np.float32) for name in ("plant_error", "plant_height")])
    las = laspy.LasData(header)
    las.x, las.y, las.z = (ground.xyz + [500_000, 3_500_000, 50]).T
    las.return_number = las.number_of_returns = np.ones(len(ground.xyz), dtype=np.uint8)
    las.classification = np.full(len(ground.xyz), 2)
    if dimensions:
        las.plant_error, las.plant_height = ground.plants.error, ground.plants.height
    las.write(path)
    return path
