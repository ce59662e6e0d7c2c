"""Cloth Simulation Filter (Zhang et al. 2016, doi:10.3390/rs8060501) by its authors' library, in a child process."""

from __future__ import annotations

import json
import math
import os
import sys
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from ...interface.parameters import GroundParameters
from ..core import child_process
from ..core.errors import EngineError, InputError
from ..core.temporary_folders import temporary_folder
from ..geometry.columns import greatest, least, spans

MAX_CLOTH_PARTICLES = 16_000_000
"""Particles: more would take over 8 GB."""
MAX_SEARCH_STEPS, MAX_BARE_PARTICLES = 1e8, 500
"""Steps of the library's search along rows, and particles in bare rows and columns: more take over ten seconds."""
_MAX_DISTANCE_CELLS = 3.0
_WORKER = Path(__file__).with_name("cloth_worker.py")
_BYTES_PER_PARTICLE, _BYTES_PER_POINT, _BYTES_FOR_ITSELF = 1_000, 200, 1_500_000_000


def cloth_ground(
    xyz: NDArray[np.float64],
    parameters: GroundParameters,
    *,
    threshold: float | None = None,
    origin: NDArray[np.float64] | None = None,
) -> NDArray[np.bool_]:
    """Points within ``threshold`` of the settled cloth.

    Args:
        xyz: (n, 3) finite coordinates in metres.
        parameters: resolution, rigidness, time step, iterations and smoothing of the cloth.
        threshold: distance (m) to the cloth; ``parameters.class_threshold`` by default.
        origin: (2,) m, least coordinates of the cloud of which these points are a part: its particles lie as those of
            the whole cloud's cloth.

    Returns:
        (n,) bool. The same points give the same answer: the library runs on one thread.

    Raises:
        InputError: a cloth too large, coordinates that are not finite, or the library is not there.
        EngineError: the library failed.
        Cancelled: the command is being cancelled.
    """
    if len(xyz) == 0:
        return np.zeros(0, dtype=bool)
    low = least(xyz)
    # a coordinate that is not a number crashes the library
    if not np.isfinite(low).all() or not np.isfinite(greatest(xyz)).all():
        raise InputError("The cloud has coordinates that are not finite numbers; remove them before the ground filter.")
    particles = refuse_large_cloth(xyz, parameters.cloth_resolution)
    # small coordinates keep the cloth's digits
    points = xyz - low
    added = [filling(points, parameters.cloth_resolution)]
    if origin is not None:
        added.append(_anchor(points, (origin - low[:2]) / parameters.cloth_resolution, parameters.cloth_resolution))
    points = np.vstack([points, *added])
    with temporary_folder("csf", needed_bytes=points.nbytes + len(points)) as folder:
        np.save(folder / "points.npy", points)
        options = {
            "slope_smoothing": parameters.slope_smoothing,
            "cloth_resolution": parameters.cloth_resolution,
            "rigidness": parameters.rigidness,
            "time_step": parameters.time_step,
            "iterations": parameters.iterations,
            "threshold": parameters.class_threshold if threshold is None else threshold,
        }
        (folder / "parameters.json").write_text(json.dumps(options), encoding="utf-8")
        result = child_process.run_child(
            [sys.executable, _WORKER, folder],
            memory_limit=_BYTES_FOR_ITSELF + _BYTES_PER_PARTICLE * particles + _BYTES_PER_POINT * len(xyz),
            # one thread: several give another cloth, and so other ground, from run to run
            environment={**os.environ, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"},
            directory=folder,
        )
        if b"No module named 'CSF'" in result.stderr:
            raise InputError(
                "The cloth filter (cloth-simulation-filter) is not there, as it has no build for this Python; install "
                "PDAL 2.3 or newer, or set the engine up again from Python 3.10 to 3.12."
            )
        if result.returncode:
            reason = result.stderr.decode(errors="replace").strip().splitlines()[-1:]
            raise EngineError(
                f"the cloth simulation failed (exit code {result.returncode}{', ' if reason else ''}{''.join(reason)})"
            )
        return np.asarray(np.load(folder / "ground.npy")[: len(xyz)], dtype=np.bool_)


def _anchor(points: NDArray[np.float64], steps: NDArray[np.float64], resolution: float) -> NDArray[np.float64]:
    """(1, 3) a point at the corner of points (n, 3), from where the library counts particles, as high as the nearest.

    Args:
        steps: (2,) where the whole cloud's particles begin, in particles from the points' lowest.
    """
    place = resolution * (steps - np.ceil(steps))
    nearest = np.argmin(np.abs(points[:, :2] - place).sum(axis=1))
    return np.array([[*place, points[nearest, 2]]])


def refuse_large_cloth(xyz: NDArray[np.float64], resolution: float) -> int:
    """Number of the cloth's particles over these points.

    Raises:
        InputError: more than MAX_CLOTH_PARTICLES, with a resolution that fits.
    """
    width, depth = spans(xyz[:, :2]).tolist()
    particles = math.floor(width / resolution + 4) * math.floor(depth / resolution + 4)
    if particles > MAX_CLOTH_PARTICLES:
        fits = math.ceil(100.0 * math.sqrt(width * depth / MAX_CLOTH_PARTICLES) * 1.05 + 1) / 100.0
        raise InputError(
            f"cloth_resolution is {resolution:g} m, which over {width:.0f} x {depth:.0f} m makes {particles:.2g} "
            f"particles; give at least {fits:g} m, or clip the cloud to a region of interest."
        )
    return particles


def filling(xyz: NDArray[np.float64], resolution: float) -> NDArray[np.float64]:
    """Points (m, 3) to add where much of the cloth has no point near it, as between two regions or next to a stray.

    For a particle without points the library walks along its row and column to the next one, and searches in all
    directions where both are empty, which takes hours on such a cloth. Particles far from any point get one, as low as
    the lowest at the nearest particle that has some. Empty for an ordinary cloud.
    """
    index = np.floor((xyz[:, :2] - least(xyz[:, :2])) / resolution + 0.5).astype(np.int64)
    shape = tuple(int(n) + 1 for n in greatest(index))
    bare = math.prod(n - len(np.unique(index[:, axis])) for axis, n in enumerate(shape))
    if bare <= MAX_BARE_PARTICLES and math.prod(shape) * max(shape) <= MAX_SEARCH_STEPS:
        return np.empty((0, 3))
    lowest = np.full(shape, np.inf)
    np.minimum.at(lowest, (index[:, 0], index[:, 1]), xyz[:, 2])
    distance, (i, j) = ndimage.distance_transform_edt(np.isinf(lowest), return_indices=True)
    far = np.nonzero(distance > _MAX_DISTANCE_CELLS)
    if bare <= MAX_BARE_PARTICLES and len(far[0]) * max(shape) <= MAX_SEARCH_STEPS:
        return np.empty((0, 3))
    place = least(xyz[:, :2]) + resolution * np.column_stack(far)
    return np.column_stack([place, lowest[i[far], j[far]]])
