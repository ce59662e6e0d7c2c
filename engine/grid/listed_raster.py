"""Rasters read as lists of the cells with data, so that the rectangle around an oblique slope takes no memory."""

from __future__ import annotations

import contextlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..core.errors import InputError
from ..core.messages import shown
from ..statistics.layout import Laid, Layout
from .geotiff import open_raster
from .grid import Grid

_ROWS = 512  # read at a time: a row of tiles


@dataclass(frozen=True)
class ListedRasters:
    """Bands on one grid: ``values`` float32 (n,) each, NaN where only others have data, of the cells in ``layout``."""

    values: tuple[NDArray[np.float32], ...]
    layout: Layout
    grid: Grid

    def laid(self, number: int = 0) -> Laid:
        """One of the bands with its layout."""
        return Laid(self.values[number], self.layout)


def read_listed(sources: Sequence[tuple[Path, int]]) -> ListedRasters:
    """Read bands of rasters of one grid, each a file and the band's number; the cells are those with data in any.

    Raises:
        InputError: as ``geotiff.read_raster``, or the grids differ.
    """
    with contextlib.ExitStack() as stack:
        opened = [stack.enter_context(open_raster(path, band)) for path, band in sources]
        grid = opened[0].grid
        for (path, _), other in zip(sources, opened, strict=True):
            if other.grid != grid:
                raise InputError(f"{shown(path)} has another grid than {shown(sources[0][0])}; take both of one run.")
        listed: list[NDArray[np.int64]] = []
        values: list[list[NDArray[np.float32]]] = [[] for _ in opened]
        for top in range(0, grid.rows, _ROWS):
            parts = [each.rows(top, min(top + _ROWS, grid.rows)) for each in opened]
            known = np.flatnonzero(np.logical_or.reduce([np.isfinite(part) for part in parts]))
            listed.append(known + top * grid.columns)
            for found, part in zip(values, parts, strict=True):
                found.append(part.ravel()[known])
        return ListedRasters(
            tuple(np.concatenate(found) for found in values), Layout(grid.shape, np.concatenate(listed)), grid
        )
