"""Class probabilities of every point of a cloud: window by window, averaged where windows overlap."""

from __future__ import annotations

import math
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from ...engine.core.arrays import Float, Float32
from ...engine.core.errors import InputError
from ...engine.core.progress import Progress
from ..configuration import ModelConfiguration
from ..network.batches import make_batch, network_inputs
from ..network.randlanet import RandLANet
from ..preparation.prepare import Block, PreparedCloud, blocks
from ..preparation.streaming import prepared_in_voxels
from ..preparation.voxel_sums import flat_axis
from .groups import without_faint
from .interpolation import VoxelInterpolation

_TURNS_DEG = (0.0, 10.0, -10.0, 5.0, -5.0, 12.0, -12.0, 8.0)
"""Degrees that windows are turned by whose y runs up the slope."""


@dataclass(frozen=True)
class Prediction:
    """``probabilities`` (n, classes) of the cloud's points in their order, and what they were computed on.

    ``filled`` is the share of the points that no window covered and that took the nearest covered point's.
    """

    probabilities: Float32
    cloud: PreparedCloud
    filled: float

    @property
    def labels(self) -> NDArray[np.uint8]:
        """(n,) the most probable class."""
        return self.probabilities.argmax(axis=1).astype(np.uint8)


def predict(
    network: RandLANet,
    xyz: Float,
    *,
    rotations: int = 1,
    threads: int = 1,
    device: torch.device | None = None,
    seed: int = 0,
) -> Prediction:
    """Probabilities of every point of a cloud.

    Probabilities (not logits) are added up over the windows that hold a point, their ``thinnings`` and ``rotations``
    (see ``views``), and divided by their weights. Points in no window take those of the nearest point that is in one.

    Args:
        network: in evaluation mode, on ``device``.
        xyz: (n, 3) metres.
        threads: windows that are worked on at the same time, on a processor; the result does not depend on it.

    Raises:
        InputError: the cloud cannot be prepared, or is too sparse for any window.
    """
    configuration = network.configuration
    cloud, voxel = prepared_in_voxels(xyz, configuration, seed)
    probabilities, covered = predict_voxels(
        network, cloud, rotations=rotations, threads=threads, device=device, seed=seed
    )
    filled = float(cloud.voxels.count[~covered].sum() / cloud.voxels.count.sum())
    if configuration.interpolation <= 1:
        return Prediction(probabilities[voxel], cloud, filled)
    between = VoxelInterpolation(cloud.voxels.points, configuration.voxel, configuration.interpolation)
    flat = np.stack([flat_axis(cloud.matrix, xyz, axis) for axis in range(3)], axis=1)
    return Prediction(between.at(flat, probabilities, threads), cloud, filled)


def predict_voxels(
    network: RandLANet,
    cloud: PreparedCloud,
    *,
    rotations: int = 1,
    threads: int = 1,
    device: torch.device | None = None,
    seed: int = 0,
    progress: Progress | None = None,
) -> tuple[Float32, NDArray[np.bool_]]:
    """Probabilities (m, classes) of the voxels of a prepared cloud, and which of them (m,) a window covered.

    Faint groups of voxels are background, where the configuration has a ``least_peak``.

    The other arguments are those of ``predict``.

    Raises:
        InputError: the cloud is too sparse for any window.
    """
    progress = progress or Progress()
    configuration = network.configuration
    device = device or torch.device("cpu")
    total = np.zeros((len(cloud.voxels.points), len(configuration.classes)))
    weight = np.zeros(len(total))
    run = _Run(network, configuration, device, rotations)
    jobs = (
        block
        for turn in range(configuration.thinnings)
        for block in blocks(cloud, configuration, np.random.default_rng(seed if not turn else [seed, turn]))
    )
    expected = _expected(cloud, configuration) * configuration.thinnings
    before = torch.get_num_threads()
    if device.type == "cpu" and threads > 1:
        torch.set_num_threads(1)
    try:
        for number, (block, probability) in enumerate(_in_order(run, jobs, threads)):
            # Added in the windows' order, whoever was faster. A point that a block holds twice votes twice.
            np.add.at(total, block.voxel, probability * block.weight[:, None])
            np.add.at(weight, block.voxel, block.weight)
            progress.update((number + 1) / max(expected, number + 1), "screening")
    finally:
        torch.set_num_threads(before)
    covered = weight > 0
    if not covered.any():
        raise InputError(
            f"No window of {configuration.window:g} m holds the {configuration.minimum_points} points that the model "
            "needs; give a denser or larger cloud."
        )
    total[covered] /= weight[covered, None]
    if not covered.all():
        total[~covered] = total[covered][_nearest(cloud.voxels.points, covered)]
    probabilities = total.astype(np.float32)
    if configuration.least_peak > 0:
        voxels = cloud.voxels.points
        probabilities = without_faint(voxels, probabilities, configuration.voxel, configuration.least_peak)
    return probabilities, covered


@dataclass(frozen=True)
class _Run:
    network: RandLANet
    configuration: ModelConfiguration
    device: torch.device
    rotations: int

    def __call__(self, block: Block) -> tuple[Block, Float]:
        """Probabilities (n, classes) of a block, averaged over the rotations."""
        batch = make_batch([block]).to(self.device)
        total = np.zeros((len(block), len(self.configuration.classes)))
        with torch.inference_mode():
            for number, view in enumerate(views(self.rotations, aligned=self.configuration.align)):
                coordinates = batch.coordinates
                if number:
                    matrix = coordinates.new_tensor(view)
                    coordinates = torch.cat([coordinates[:, :2] @ matrix.T, coordinates[:, 2:]], dim=1)
                features, scaled = network_inputs(coordinates, batch.residuals, self.configuration)
                logits = self.network(features, scaled, batch.graphs)
                total += torch.softmax(logits.float(), dim=1).cpu().numpy()
        return block, total / self.rotations


def views(count: int, *, aligned: bool) -> list[list[list[float]]]:
    """Matrices (2, 2) by which a window is seen, the first as it is.

    Windows of which y runs up the slope are mirrored and turned at most as far as in training; others are turned evenly
    all round.
    """
    if not aligned:
        angles, mirrored = [2 * math.pi * k / count for k in range(count)], [False] * count
    else:
        angles = [math.radians(_TURNS_DEG[k // 2 % len(_TURNS_DEG)]) for k in range(count)]
        mirrored = [k % 2 == 1 for k in range(count)]
    result = []
    for angle, mirror in zip(angles, mirrored):
        c, s, sign = math.cos(angle), math.sin(angle), -1.0 if mirror else 1.0
        result.append([[c * sign, -s], [s * sign, c]])
    return result


def _in_order(run: _Run, jobs: Iterator[Block], threads: int) -> Iterator[tuple[Block, Float]]:
    """Results in the order of the jobs, at most ``threads`` + 1 of them under way at once."""
    if threads <= 1:
        yield from map(run, jobs)
        return
    with ThreadPoolExecutor(threads) as pool:
        waiting = []
        for block in jobs:
            waiting.append(pool.submit(run, block))
            if len(waiting) > threads:
                yield waiting.pop(0).result()
        for future in waiting:
            yield future.result()


def _expected(cloud: PreparedCloud, configuration: ModelConfiguration) -> int:
    """About how many blocks there will be."""
    low, high = (f(cloud.voxels.points[:, :2], axis=0) for f in (np.min, np.max))
    each = np.maximum(np.ceil((high - low - configuration.window) / configuration.step), 0) + 1
    return int(each.prod())


def _nearest(points: Float, covered: NDArray[np.bool_]) -> NDArray[np.intp]:
    """For each uncovered point, which of the covered is nearest."""
    return np.asarray(cKDTree(points[covered]).query(points[~covered])[1])
