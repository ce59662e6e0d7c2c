"""From a cloud to what the network reads: flat frame, voxels, residual heights, windows, pyramids."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...engine.core.arrays import Float, Float32, Index
from ...engine.core.errors import InputError
from ...engine.geometry.dominant_plane import Plane, apply_matrix, fit_plane, flattening_matrix
from ..configuration import ModelConfiguration
from .pyramid import Level, build_pyramid
from .trends import residual_heights
from .voxels import VoxelGrid, voxel_grid
from .windows import Window, centre_weight, cover_fixed, sample_fixed, windows

MIN_DIP_SINE = np.sin(np.radians(5.0))
"""Below this sine of the dip there is no up-slope direction to turn a cloud to."""
USUAL_ROUGHNESS = 0.08
"""Heights over a trend are brought to this scatter (m) where a model asks for its cloud's own roughness as the unit."""
MIN_ROUGHNESS_M = 0.02
NORMAL_30 = 0.38532
"""30 % of a normal distribution lie within so many standard deviations of its middle."""


@dataclass(frozen=True)
class PreparedCloud:
    """A cloud in its flat frame.

    ``matrix`` (4, 4) leads there from the cloud's coordinates; ``voxels`` are in that frame; ``residuals`` (m, radii)
    are the voxels' heights over the trends, m.
    """

    plane: Plane
    matrix: Float
    voxels: VoxelGrid
    residuals: Float32


@dataclass(frozen=True)
class Block:
    """What the network is given for one window.

    ``coordinates`` (n, 3): metres about the window's middle (x, y) and the block's mean height. ``residuals`` (n,
    radii) in metres. ``levels``: its pyramid. ``voxel`` (n,): the voxel that each point is. ``weight`` (n,): what its
    vote counts. ``labels`` (n,): class, 255 where unknown or not to be trained on.
    """

    coordinates: Float32
    residuals: Float32
    levels: tuple[Level, ...]
    voxel: Index
    weight: Float32
    labels: NDArray[np.uint8]

    def __len__(self) -> int:
        return len(self.coordinates)


UNKNOWN = 255
"""The label of points that are not trained on."""


def prepare_cloud(xyz: Float, configuration: ModelConfiguration, seed: int = 0) -> PreparedCloud:
    """Lay a cloud flat, average it in voxels and measure heights over the trends.

    Args:
        xyz: (n, 3) metres, any origin.

    Raises:
        InputError: too few points, points on a line, or coordinates that are not numbers.
    """
    if len(xyz) < 50:
        raise InputError(f"There are {len(xyz)} ground points but screening needs at least 50; check the cloud.")
    if not np.isfinite(xyz).all():
        raise InputError("Some of the cloud's coordinates are not numbers; repair the file or remove these points.")
    plane, matrix = flat_frame(xyz, configuration, seed)
    return prepared(plane, matrix, voxel_grid(apply_matrix(matrix, xyz), configuration.voxel), configuration)


def flat_frame(xyz: Float, configuration: ModelConfiguration, seed: int = 0) -> tuple[Plane, Float]:
    """The plane of points (n, 3) and the matrix (4, 4) that lays them flat on it."""
    plane = fit_plane(xyz, configuration.plane_distance, configuration.plane_iterations, seed)
    matrix = flattening_matrix(plane)
    if configuration.align:
        matrix = _up_slope(matrix) @ matrix
    return plane, matrix


def prepared(plane: Plane, matrix: Float, voxels: VoxelGrid, configuration: ModelConfiguration) -> PreparedCloud:
    """Measure the heights of voxels in the flat frame over the trends."""
    residuals = np.zeros((len(voxels.points), 0), dtype=np.float32)
    if "residuals" in configuration.features:
        columns = [residual_heights(voxels.points, along, up) for along, up in configuration.trends]
        residuals = np.stack(columns, axis=1).astype(np.float32)
        if configuration.own_roughness:
            residuals *= USUAL_ROUGHNESS / roughness(residuals)
    return PreparedCloud(plane, matrix, voxels, residuals)


def roughness(residuals: Float32) -> Float32:
    """Robust standard deviation (trends,) of heights (m, trends) over each trend, m; not below ``MIN_ROUGHNESS_M``.

    From the smallest 30 % of the distances to the median, so that edges and hazards on two thirds of the ground count
    little.
    """
    away = np.abs(residuals - np.median(residuals, axis=0))
    return np.maximum(np.quantile(away, 0.3, axis=0) / NORMAL_30, MIN_ROUGHNESS_M).astype(np.float32)


def _up_slope(matrix: Float) -> Float:
    """(4, 4) rotation about the vertical that turns the flat frame's up-slope direction to +y; none on flat ground."""
    turn = np.eye(4)
    up = matrix[:2, 2]  # where the world's vertical points in the flat frame
    length = float(np.hypot(*up))
    if length > MIN_DIP_SINE:
        c, s = up[1] / length, up[0] / length
        turn[:2, :2] = [[c, -s], [s, c]]
    return turn


def blocks(
    cloud: PreparedCloud,
    configuration: ModelConfiguration,
    rng: np.random.Generator,
    labels: NDArray[np.uint8] | None = None,
    *,
    every_point: bool = True,
    share: float = 1.0,
    workers: int = 1,
) -> Iterator[Block]:
    """The cloud's blocks, window by window.

    Args:
        labels: of the voxels; unknown by default.
        every_point: where a window has more than the fixed number of points, make as many blocks as hold them all (for
            inference) rather than one random sample (for training).
        share: of the windows, chosen at random, at least one.
        workers: threads of the neighbour search.
    """
    points = cloud.voxels.points
    if labels is None:
        labels = np.full(len(points), UNKNOWN, dtype=np.uint8)
    spread = configuration.minimum_points == 0
    found = windows(points, configuration.window, configuration.step, configuration.minimum_points, spread=spread)
    if share < 1.0 and found:
        few = rng.choice(len(found), max(1, round(share * len(found))), replace=False)
        found = [found[k] for k in sorted(few)]
    for window in found:
        for chosen in _samples(window, configuration.block_points, rng, every_point):
            yield _block(cloud, configuration, window, chosen, labels, rng, workers)


def _samples(window: Window, count: int, rng: np.random.Generator, every_point: bool) -> Iterator[Index]:
    if not count:
        yield window.points
    elif every_point:
        yield from cover_fixed(window.points, count, rng)
    else:
        yield sample_fixed(window.points, count, rng)


def _block(
    cloud: PreparedCloud,
    configuration: ModelConfiguration,
    window: Window,
    chosen: Index,
    labels: NDArray[np.uint8],
    rng: np.random.Generator,
    workers: int,
) -> Block:
    points = cloud.voxels.points[chosen]
    # As published the block's centroid is subtracted; windows that end with the cloud have their middle instead.
    middle = points.mean(axis=0)
    if configuration.centre_weighting:
        middle[:2] = window.middle
    weight = np.ones(len(chosen))
    if configuration.centre_weighting:
        weight = centre_weight(points, window.middle, configuration.window)
    coordinates = (points - middle).astype(np.float32)
    levels = build_pyramid(
        coordinates,
        len(configuration.widths),
        configuration.neighbours,
        configuration.decimation,
        rng,
        workers,
        spacing=configuration.voxel if configuration.sampling == "grid" else None,
    )
    return Block(coordinates, cloud.residuals[chosen], levels, chosen, weight.astype(np.float32), labels[chosen])
