"""The highest point of each pixel of a picture from straight above."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core.arrays import Float, Index
from ..grid.grid import Grid, cell_index
from ..pointcloud.cloud import PointCloud
from ..pointcloud.in_parts import CloudFile
from ..pointcloud.reading import eight_bits
from ..statistics.layout import bands

_PART_POINTS = 1_000_000


def highest(xyz: Float, grid: Grid) -> tuple[Index, Index, Index]:
    """The pixels with points (k,), flat and ascending, the highest point of each (the last of equally high ones), and
    all that are as high as these (m,).

    Band by band of the grid, so that no array of all its pixels is made.
    """
    index = cell_index(xyz, grid)
    parts = bands(grid.shape)
    # numbers of 16 bits are sorted without comparing them
    band = (index // (grid.columns * (parts[0].stop - parts[0].start))).astype(np.int16 if len(parts) < 2**15 else int)
    order = np.argsort(band, kind="stable")
    start = np.searchsorted(band[order], np.arange(len(parts) + 1))
    pixels, points, every = ([np.zeros(0, dtype=np.int64)] for _ in range(3))
    for number, rows in enumerate(parts):
        here = order[start[number] : start[number + 1]]
        place, z = index[here] - rows.start * grid.columns, xyz[here, 2]
        heights = np.full((rows.stop - rows.start) * grid.columns, -np.inf)
        np.maximum.at(heights, place, z)
        highest = np.flatnonzero(z == heights[place])
        last = np.full(heights.size, -1, dtype=np.int64)
        last[place[highest]] = here[highest]
        filled = np.flatnonzero(last >= 0)
        pixels.append(filled + rows.start * grid.columns)
        points.append(last[filled])
        every.append(here[highest])
    return np.concatenate(pixels), np.concatenate(points), np.concatenate(every)


def highest_points(cloud: CloudFile, grid: Grid) -> PointCloud:
    """A cloud's points that no other of their pixel of ``grid`` is higher than, in the cloud's order.

    ``top_view.project`` shows of them what it shows of the whole cloud, which is read in parts.
    """
    held: list[PointCloud] = []
    largest, points = 0, 0
    for part in cloud.parts():
        largest = max(largest, 0 if part.rgb is None else int(part.rgb.max(initial=0)))
        held.append(part)
        points += len(part)
        if points > _PART_POINTS + 2 * len(held[0]):
            held = [_only_highest(held, grid)]
            points = len(held[0])
    found = _only_highest(held, grid)
    if found.rgb is None:
        return found
    # as in the whole cloud, whose brightest colour says of how many bits all are
    return replace(found, rgb=eight_bits(np.asarray(found.rgb, dtype=np.uint16), largest))


def _only_highest(parts: list[PointCloud], grid: Grid) -> PointCloud:
    xyz = np.concatenate([part.xyz for part in parts])
    chosen = np.sort(highest(xyz, grid)[2])

    def of(arrays: list[NDArray[Any] | None]) -> NDArray[Any] | None:
        known = [array for array in arrays if array is not None]
        return np.concatenate(known)[chosen] if known else None

    rgb, intensity = of([part.rgb for part in parts]), of([part.intensity for part in parts])
    return PointCloud(xyz[chosen], parts[0].crs, parts[0].path, rgb=rgb, intensity=intensity)
