"""Writing scenes: a LAZ file each with the truth on every point, the hazards as points, and what all of it is."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import geopandas
import numpy as np
from numpy.typing import NDArray
from pyproj import CRS

from ...engine.pointcloud.cloud import PointCloud
from ...engine.pointcloud.writing import write_cloud
from ...engine.vector.geopackage import write_layer
from ...interface.parameters import ScenesParameters
from ..surveys.write import write_json
from .negatives import Negative
from .scenes import SimulatedScene
from .styles import SIMULATOR_VERSION, SceneSpec

CLASS_NAMES = ("background", "uplift", "subsidence")
"""Names of the classes 0, 1 and 2."""
SCENE_CRS = "EPSG:32651"
"""The scenes lie nowhere; their coordinates are of the size that a projected system has."""
DIMENSIONS = {
    "truth_class": "class of the point: 0 background, 1 uplift, 2 subsidence",
    "truth_displacement": "displacement of the ground there along the normal of the mean plane, m; outwards positive",
    "truth_ignore": "1: so close to the limit between two classes that training leaves the point out",
    "negative": "hard negative at the point, by its number in negatives",
    "hazard": "id of the hazard's part in hazards.gpkg, -1: none",
}
"""Extra dimensions of the clouds and what they hold."""


def scene_name(spec: SceneSpec) -> str:
    """The file that a scene is written to."""
    return f"{spec.kind}_{spec.seed:07d}.laz"


def write_scene(path: Path, scene: SimulatedScene) -> None:
    """Write a scene's points with the truth in the extra dimensions ``DIMENSIONS``; the class is not in Classification,
    which says that all points are ground (2).

    Raises:
        InputError: the folder is missing or cannot be written.
    """
    cloud = PointCloud(xyz=scene.xyz, crs=CRS.from_user_input(SCENE_CRS), path=path)
    values: dict[str, NDArray[np.generic]] = {
        "truth_class": scene.label,
        "truth_displacement": scene.displacement,
        "truth_ignore": scene.ignore.astype(np.uint8),
        "negative": scene.negative,
        "hazard": scene.hazard,
    }
    write_cloud(path, cloud, dimensions=values, classification=np.full(len(scene), 2, dtype=np.uint8))


def write_hazards(path: Path, tables: Sequence[tuple[str, NDArray[np.void]]]) -> None:
    """Write the hazards of all scenes, (file name, ``SimulatedScene.hazards``) each, as points of a GeoPackage's layer
    ``hazards``; a hazard that rose and sank is two.
    """
    rows = [(name, row) for name, table in tables for row in table]
    frame = geopandas.GeoDataFrame(
        {
            "scene": [name for name, _ in rows],
            "id": np.array([row["id"] for _, row in rows], dtype=np.int64),
            "hazard": np.array([row["hazard"] for _, row in rows], dtype=np.int64),
            "kind": [str(row["kind"]) for _, row in rows],
            "class": [CLASS_NAMES[int(row["label"])] for _, row in rows],
            "amplitude_m": np.array([row["amplitude"] for _, row in rows], dtype=np.float64),
            "diameter_m": np.array([row["size"] for _, row in rows], dtype=np.float64),
            "area_m2": np.array([row["area"] for _, row in rows], dtype=np.float64),
        },
        geometry=geopandas.points_from_xy([row["x"] for _, row in rows], [row["y"] for _, row in rows]),
        crs=SCENE_CRS,
    )
    write_layer(path, frame, "hazards", geometry_type="Point")


def scene_entry(name: str, scene: SimulatedScene) -> dict[str, Any]:
    """The manifest's entry of a scene."""
    count = np.bincount(scene.label, minlength=len(CLASS_NAMES))
    negatives = np.bincount(scene.negative, minlength=len(Negative))
    return {
        "file": name,
        **asdict(scene.spec),
        "points": len(scene),
        "class_points": {name: int(n) for name, n in zip(CLASS_NAMES, count)},
        "class_shares": {name: round(share, 4) for name, share in zip(CLASS_NAMES, scene.shares)},
        "label_limit_m": round(scene.limit, 4),
        "dip_degrees": round(scene.dip, 2),
        "dip_azimuth_degrees": scene.frame.dip_azimuth,
        "hazards": len(np.unique(scene.hazards["hazard"])),
        "negative_points": {kind.name.lower(): int(negatives[kind]) for kind in Negative if negatives[kind]},
    }


def write_manifest(path: Path, parameters: ScenesParameters, entries: list[dict[str, Any]]) -> dict[str, float]:
    """Write what the scenes are: parameters, simulator's version, names of the numbers, an entry for each scene.

    Returns:
        Shares of the classes among all points.
    """
    count = np.array([list(entry["class_points"].values()) for entry in entries], dtype=np.float64).sum(axis=0)
    shares = {name: round(float(share), 4) for name, share in zip(CLASS_NAMES, count / count.sum())}
    document = {
        "simulator_version": SIMULATOR_VERSION,
        "parameters": asdict(parameters),
        "seed": parameters.seed,
        "points": int(count.sum()),
        "class_shares": shares,
        "classes": dict(enumerate(CLASS_NAMES)),
        "negatives": {int(kind): kind.name.lower() for kind in Negative},
        "dimensions": DIMENSIONS,
        "scenes": entries,
    }
    write_json(path, document)
    return shares
