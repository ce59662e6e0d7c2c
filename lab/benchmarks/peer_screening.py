"""Screening of one survey: SlopeWatch's methods on labelled hazards, and the published networks that were asked for.

A published RandLA-Net needs a framework that installs beside this Python; where none does, its row says how it failed.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import laspy
import numpy as np
from numpy.typing import NDArray

from ...engine.core.arrays import Float
from ...engine.core.version import VERSION
from ...engine.geometry.dominant_plane import apply_matrix
from ...engine.geometry.hazard_shapes import smooth_hazard
from ...models.preparation.inserted_hazards import insert_hazards
from ...models.preparation.prepare import flat_frame
from ...models.screening.cloud_file import CLASS
from ...simulation.hazard_scenes.scenes import scene
from ...simulation.hazard_scenes.write import write_scene
from .peer_case import Case, Judged, Tool, script_tool
from .peers import version
from .screening_ground import FRAME
from .strips import FILE, SOURCES

AREA_M2, QUICK_AREA_M2 = 2_000.0, 400.0
DENSITY = 150.0
SIDE_M, QUICK_SIDE_M = 120.0, 60.0
HEIGHTS_M, DIAMETERS_M = (0.5, -0.5, 0.8, -0.8, 1.2, -1.2), (5.0, 8.0)
ROUNDS = 3
PUBLISHED = """
import torch
from torch_points3d.applications.pretrained_api import PretainedRegistry
"""
OPEN3D_ML = """
import open3d.ml.torch as ml
ml.models.RandLANet()
"""


def cases(quick: bool) -> list[Case]:
    """A simulated scene, and known hazards put into a real gullied hillside."""
    tools = (
        _screen("SlopeWatch screen, relief", "relief", own=True),
        _screen("RandLA-Net as shipped with SlopeWatch", "network"),
        _screen("threshold on the height over a trend", "residual"),
        script_tool("RandLA-Net of Torch-Points3D", "torch_points3d", version("torch_points3d"), PUBLISHED),
        script_tool("RandLA-Net of Open3D-ML", "open3d", version("open3d"), OPEN3D_ML),
    )
    found = [Case("screening", "simulated scene", lambda folder: _scene(folder, quick), _judge, tools)]
    if FILE.exists():
        title = "real gullied hillside, hazards put in"
        found.append(Case("screening", title, lambda folder: _hillside(folder, quick), _judge, tools))
    return found


def _screen(name: str, method: str, *, own: bool = False) -> Tool:
    """The command as a whole, libraries and files included; its help is what starting takes."""
    program = [sys.executable, "-m", "slopewatch.cli", "screen"]

    def command(folder: Path) -> list[str]:
        words = ["--output", folder / "found" / "labelled.laz", "--method", method, "--ground", "as_is"]
        return [*program, str(folder / "ground.laz"), *map(str, words), "--progress", "none"]

    return Tool(name, VERSION, command, lambda folder: [*program, "--help"], own)


def _scene(folder: Path, quick: bool) -> NDArray[np.uint8]:
    made = scene(1, "realistic", area=QUICK_AREA_M2 if quick else AREA_M2, density=DENSITY)
    write_scene(folder / "ground.laz", made)
    return np.asarray(made.label, dtype=np.uint8)


def _hillside(folder: Path, quick: bool) -> NDArray[np.uint8]:
    """The middle of one strip, bulges and bowls square to its slope at random places."""
    las = laspy.read(FILE)
    xyz = np.array(las.xyz)[np.asarray(las.point_source_id) == SOURCES[0]]
    side = QUICK_SIDE_M if quick else SIDE_M
    offset = np.abs(xyz[:, :2] - np.median(xyz[:, :2], axis=0))
    given, label = with_hazards(xyz[(offset < side / 2).all(axis=1)], 1)
    out = laspy.create(point_format=6, file_version="1.4")
    out.header.scales, out.header.offsets = [0.001] * 3, np.floor(given.min(axis=0))
    out.header.add_crs(las.header.parse_crs())
    out.x, out.y, out.z = given.T
    out.classification = np.full(len(given), 2, dtype=np.uint8)
    out.write(folder / "ground.laz")
    return label


def with_hazards(xyz: Float, seed: int) -> tuple[Float, NDArray[np.uint8]]:
    """Ground points (n, 3) with hazards of HEIGHTS_M and DIAMETERS_M in them, as many as have room, and labels (n,)."""
    rng = np.random.default_rng(seed)
    _, matrix = flat_frame(xyz, FRAME)
    wanted = [smooth_hazard(height, size, rng) for height in HEIGHTS_M for size in DIAMETERS_M] * ROUNDS
    made = insert_hazards(apply_matrix(matrix, xyz), wanted, rng)
    return apply_matrix(np.asarray(np.linalg.inv(matrix), dtype=np.float64), made.flat), made.label


def _judge(truth: NDArray[np.uint8], found: Path, printed: Mapping[str, Any]) -> Judged:
    """Intersection over union of uplift and subsidence, from the points' labels; its rest to 100 % is the error."""
    label = np.asarray(laspy.read(found / "labelled.laz")[CLASS])
    shares = [iou(label == kind, truth == kind) for kind in (1, 2)]
    mean = 100 * float(np.mean(shares))
    false = 100 * float(np.mean(label[truth == 0] > 0))
    return Judged(100 - mean, f"IoU of hazards {mean:.1f} %; {false:.2f} % of the other points labelled so")


def iou(found: NDArray[np.bool_], true: NDArray[np.bool_]) -> float:
    """Intersection over union of two masks (n,); 1 where both are empty."""
    either = np.count_nonzero(found | true)
    return np.count_nonzero(found & true) / either if either else 1.0
