"""Slopes with a known bulge and hollow, written by laspy, small weights, and the step that screens, for the tests of
screening.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import laspy
import numpy as np
import pytest
from pyproj import CRS
from slopewatch.engine.core.messages import shown
from slopewatch.interface.parameters import GroundParameters, InputParameters, ScreeningParameters
from slopewatch.models.screening.screen import chosen_by_class, screen_points
from slopewatch.models.screening.zones import outline_hazards
from slopewatch.workflows.products.screening import default_targets
from slopewatch.workflows.screen import screen_step
from slopewatch.workflows.settings import ScreeningSettings

WEST, SOUTH = 500_000.0, 3_500_000.0
BULGE, HOLLOW, RADIUS, HEIGHT = (6.0, 14.0), (15.0, 7.0), 2.0, 0.4
DIP = 35.0


def slope(points: int = 40_000, *, dip: float = DIP, seed: int = 0, noise: float = 0.01) -> np.ndarray:
    """(n, 3) m of a slope of 22 x 22 m on the map that rises northwards, with a bulge and a hollow square to it."""
    rng = np.random.default_rng(seed)
    x, y = rng.uniform(0, 22, (2, points))
    raised = np.zeros(points)
    for (u, v), sign in ((BULGE, 1.0), (HOLLOW, -1.0)):
        distance = np.hypot(x - u, (y - v) / np.cos(np.radians(dip)))
        raised += sign * HEIGHT * np.clip(1 - (distance / RADIUS) ** 4, 0, None)
    raised += rng.normal(0, noise, points)
    z = 50 + y * np.tan(np.radians(dip)) + raised / np.cos(np.radians(dip))
    return np.column_stack([x + WEST, y + SOUTH, z])


def write(path: Path, xyz: np.ndarray, *, point_format: int = 7, crs: int | None = 32651, unit: float = 1.0, **dims):
    """Write points given in metres in the unit of ``crs`` (metres a unit), with every dimension filled."""
    rng = np.random.default_rng(9)
    header = laspy.LasHeader(point_format=point_format, version="1.4")
    header.scales, header.offsets = [0.001] * 3, np.floor(xyz.min(axis=0) / unit)
    if crs:
        header.add_crs(CRS.from_epsg(crs))
    for name, values in dims.items():
        if name not in header.point_format.dimension_names:
            header.add_extra_dim(laspy.ExtraBytesParams(name, values.dtype))
    las = laspy.LasData(header)
    las.xyz = xyz / unit
    las.return_number = las.number_of_returns = np.ones(len(xyz), dtype=np.uint8)
    las.intensity = rng.integers(0, 2000, len(xyz))
    las.gps_time = rng.uniform(0, 60, len(xyz))
    if "red" in las.point_format.dimension_names:
        las.red, las.green, las.blue = (rng.integers(0, 65536, len(xyz)) for _ in range(3))
    for name, values in dims.items():
        las[name] = values
    las.write(path)
    return path


def small_weights(path: Path, decision: str = "zones") -> Path:
    """Weights of a small network that has learnt nothing: its answers vary from place to place."""
    torch = pytest.importorskip("torch", reason="torch is not installed; install slopewatch[screening]")
    from slopewatch.models.configuration import SMOKE
    from slopewatch.models.network.randlanet import RandLANet
    from slopewatch.models.network.weights import save_model

    torch.set_num_threads(1)
    torch.manual_seed(5)
    save_model(path, RandLANet(replace(SMOKE, window=12.0, step=8.0, decision=decision)).eval(), {}, {})
    return path


def near(xyz: np.ndarray, place: tuple[float, float], reach: float) -> np.ndarray:
    """Which points lie within ``reach`` m of a place on the map."""
    return np.hypot(xyz[:, 0] - WEST - place[0], xyz[:, 1] - SOUTH - place[1]) < reach


def screen(path, output, *, roi=None, inputs=None, progress=None, method="residual", **parameters):
    """Screen a file into ``output`` and what lies beside it, without learning unless asked for."""
    settings = ScreeningSettings(
        inputs or InputParameters(),
        GroundParameters(),
        ScreeningParameters(screening_method=method, threads=1, **parameters),
    )
    return screen_step(path, default_targets(output), settings, roi=roi, progress=progress)


def screen_cloud(cloud, parameters, run_id=""):
    """Screen a ground cloud in memory: the screening, and its rasters and zones."""
    labels = np.zeros(len(cloud), np.uint8) if cloud.classification is None else cloud.classification
    chosen = chosen_by_class(labels, parameters.ground)
    classified = bool((labels == 2).any())
    ground = SimpleNamespace(
        name=shown(cloud.path),
        parts=lambda: iter([cloud.xyz[chosen]]),
        classified=classified,
        bare=classified and bool((labels[chosen] == 2).all()),
    )
    screening = screen_points(ground, parameters)
    return screening, outline_hazards(screening, cloud.crs, parameters, run_id=run_id)


def leftovers(folder: Path) -> list[str]:
    """Clouds, layers, rasters, pictures and hidden files in a folder."""
    return sorted(p.name for p in folder.iterdir() if p.suffix in (".laz", ".gpkg", ".tif", ".png") or p.name[0] == ".")
