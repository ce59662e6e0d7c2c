"""Preparing a cloud of any size: its parts are read twice, and only a sample and the voxels are held.

``prepare.prepare_cloud`` does the same with all points in memory, for training.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...engine.core.arrays import Float
from ...engine.core.errors import InputError
from ...engine.geometry.dominant_plane import Plane
from ..configuration import ModelConfiguration
from .prepare import PreparedCloud, flat_frame, prepared
from .thinning import Thinning
from .trends import trend_cell
from .voxel_sums import SparseVoxels, VoxelSums

Parts = Callable[[], Iterable[Float]]
"""Gives the parts (n, 3) of a cloud in its order, anew at each call."""
MIN_POINTS = 50
MAX_CELLS = 8_000_000
"""Of the rasters that trends are fitted on, at 170 bytes a cell; half a square kilometre with a reach of 1.5 m."""
SAMPLE = 1_000_000
"""Points that the plane is fitted to; all of a smaller cloud."""


@dataclass(frozen=True)
class Sample:
    """Evenly thinned points (n, 3) of a cloud, and how many it has."""

    xyz: Float
    points: int


def sample_parts(parts: Parts, name: str = "The cloud") -> Sample:
    """A sample of a cloud; ``name`` is what messages call it.

    Raises:
        InputError: too few points, or coordinates that are not numbers.
    """
    thinning = Thinning(SAMPLE)
    for xyz in parts():
        if not np.isfinite(xyz).all():
            raise InputError(f"{name} has coordinates that are not numbers; repair it or remove these points.")
        thinning.add(xyz)
    if thinning.seen < MIN_POINTS:
        raise InputError(
            f"{name} has {thinning.seen} ground points but screening needs at least {MIN_POINTS}; check it."
        )
    return Sample(np.asarray(thinning.rows(), dtype=np.float64), thinning.seen)


def prepare_parts(
    parts: Parts,
    sample: Sample,
    configuration: ModelConfiguration,
    seed: int = 0,
    *,
    spread: bool = False,
    frame: tuple[Plane, Float] | None = None,
) -> tuple[PreparedCloud, SparseVoxels]:
    """The prepared cloud, without ``inverse``, and where each point's voxel is.

    Args:
        spread: also how the points of a voxel spread about their average.
        frame: plane and matrix as ``flat_frame`` found them on the sample, if it was asked already.

    Raises:
        InputError: the plane cannot be found, or the cloud is too wide for its trends' rasters or for numbered voxels.
    """
    plane, matrix = frame or flat_frame(sample.xyz, configuration, seed)
    voxels = sum_parts(parts, matrix, configuration.voxel, spread=spread)
    _refuse_wide(voxels.grid.points, configuration)
    return prepared(plane, matrix, voxels.grid, configuration), voxels


def _refuse_wide(points: Float, configuration: ModelConfiguration) -> None:
    length, height = (float(n) for n in np.ptp(points[:, :2], axis=0))
    cells = [length * height / (trend_cell(along) * trend_cell(up)) for along, up in configuration.trends]
    if cells and max(cells) > MAX_CELLS:
        raise InputError(
            f"The cloud reaches over {length:.0f} x {height:.0f} m of its slope's plane, which takes too much memory; "
            "remove its outliers, or cut out a part of the slope."
        )


def sum_parts(parts: Parts, matrix: Float, size: float, *, spread: bool = False) -> SparseVoxels:
    """The voxels of a cloud in the frame that ``matrix`` leads to."""
    sums = VoxelSums(matrix, size, spread=spread)
    for xyz in parts():
        sums.add(xyz)
    return sums.finish()


def prepared_in_voxels(
    xyz: Float, configuration: ModelConfiguration, seed: int = 0
) -> tuple[PreparedCloud, NDArray[np.int64]]:
    """A cloud (n, 3) in memory prepared like one in parts, and the voxel (n,) of each point.

    Raises:
        InputError: see ``sample_parts`` and ``prepare_parts``.
    """

    def whole() -> Iterable[Float]:
        yield xyz

    cloud, voxels = prepare_parts(whole, sample_parts(whole), configuration, seed)
    return cloud, voxels.lookup(xyz)
