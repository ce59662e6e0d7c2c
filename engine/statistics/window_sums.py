"""Sums over square windows of cells, as fast for large windows as for small ones."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core.arrays import Float
from ..core.compiled import compiled, pays
from . import window_kernels

Cells = NDArray[np.intp]
"""Cells of a grid (n,) by their flat index, ascending."""

_BAND = 40_000  # cells of a grid to sum at a time: what a processor's cache holds of some fields
_MAX_TABLE_CELLS = 16  # of a grid for each wanted cell, up to which it is held as a whole
_MIN_COMPILED_CELLS = 20_000_000  # wanted and known, from which on loading the compiled loop pays for itself


def slide(cells: NDArray[Any], size: int, step: int = 1, join: np.ufunc = np.add) -> NDArray[Any]:
    """``join`` of ``size`` cells each: the k-th, and those ``step``, 2 ``step``, ... after it; (n - (size - 1) step,).

    Of a grid's cells line by line, windows along the lines and then, with a line's length for ``step``, of those
    across them make squares; windows that reach past the end of a line wrap round and are not used. A window's
    sum holds only its own cells, so that a large value elsewhere costs it no digit; whole numbers count
    modulo 2^16 or 2^32, and only the sum itself must fit.
    """
    length = cells.size - (size - 1) * step
    joined, start, width = None, 0, 1  # windows of 1, 2, 4, ... cells, of which the size is made
    while True:
        if size & width:
            part = cells[start * step :][:length]
            joined = part if joined is None else join(joined, part)
            start += width
        if 2 * width > size:
            assert joined is not None
            return joined
        cells = join(cells[: -width * step], cells[width * step :])
        width *= 2


@dataclass(frozen=True)
class Windows:
    """Windows of 2 ``radius`` + 1 cells a side around the cells ``cell`` of a grid of ``shape`` (rows, columns)."""

    cell: Cells
    shape: tuple[int, int]
    radius: int

    @property
    def size(self) -> int:
        return 2 * self.radius + 1

    @property
    def lines(self) -> int:
        """Rows of the grid that are summed at a time."""
        return max(_BAND // self.shape[1], 4 * self.radius, 1)

    def padded(self, cell: Cells, *fields: NDArray[Any]) -> list[NDArray[Any]]:
        """The grid with ``radius`` cells more on every side: values (k,) at the cells ``cell`` (k,), 0 elsewhere."""
        rows, columns = self.shape
        line = columns + 2 * self.radius
        place = cell + (cell // columns) * (2 * self.radius) + self.radius * (line + 1)
        grids = [np.zeros((rows + 2 * self.radius, line), dtype=field.dtype) for field in fields]
        for grid, field in zip(grids, fields, strict=True):
            grid.ravel()[place] = field
        return grids

    def totals(self, cell: Cells, *fields: NDArray[Any]) -> list[NDArray[Any]]:
        """Sum over the windows, (n,), of each of ``fields``, values (k,) at the cells ``cell`` (k,)."""
        # whole numbers of 32 bits add up exactly in floats, too
        narrow = all(
            field.dtype == np.float64 or (field.dtype.kind in "iu" and field.itemsize <= 4) for field in fields
        )
        if narrow and self.compiled_pays(len(fields) * cell.size):
            found = self._compiled(cell, np.array(fields, dtype=np.float64))
            return [total.astype(field.dtype, copy=False) for total, field in zip(found, fields, strict=True)]
        return self.totals_by_numpy(cell, *fields)

    def compiled_pays(self, known: int) -> bool:
        """Whether a compiled loop over these windows, with values of ``known`` cells, is the faster way."""
        return pays(self.cell.size + known, _MIN_COMPILED_CELLS)

    def _compiled(self, cell: Cells, values: Float) -> Float:
        return _window_sums(self.cell, cell, values, self.shape, self.radius, self.lines)

    def totals_by_numpy(self, cell: Cells, *fields: NDArray[Any]) -> list[NDArray[Any]]:
        """As ``totals``, of fields of any type."""
        totals = [np.empty(self.cell.size, dtype=field.dtype) for field in fields]
        for here, part, row, column in self.parts():
            line = part[1].stop - part[1].start
            corner = row * line + column
            within, place = self._places_in(part, cell)
            for total, field in zip(totals, fields, strict=True):
                grid = np.zeros((part[0].stop - part[0].start) * line, dtype=field.dtype)
                grid[place] = field[within]
                total[here] = slide(slide(grid, self.size), self.size, line).take(corner)
        return totals

    def any(self, cell: Cells) -> NDArray[np.bool_]:
        """Whether any of the cells ``cell`` (k,) is in the windows, (n,)."""
        if self.shape[0] * self.shape[1] < _MAX_TABLE_CELLS * self.cell.size and cell.size * self.size < self.cell.size:
            return self._marked(cell)
        found = np.zeros(self.cell.size, dtype=bool)
        for here, part, row, column in self.parts():
            line = part[1].stop - part[1].start
            _, place = self._places_in(part, cell)
            if not place.size:
                continue
            grid = np.zeros((part[0].stop - part[0].start) * line, dtype=bool)
            grid[place] = True
            along = slide(grid, self.size, join=np.logical_or)
            found[here] = slide(along, self.size, line, np.logical_or).take(row * line + column)
        return found

    def _marked(self, cell: Cells) -> NDArray[np.bool_]:
        """As ``any``, of few cells in a grid that is held as a whole."""
        (marks,) = self.padded(cell, np.ones(cell.size, dtype=bool))
        row, column = np.divmod(cell, self.shape[1])
        for by in range(self.size):
            marks[row + by, column + self.radius] = True
        row, column = np.nonzero(marks)
        for by in range(-self.radius, self.radius + 1):
            marks[row, column + by] = True
        inside: NDArray[np.bool_] = marks[
            self.radius : self.radius + self.shape[0], self.radius : self.radius + self.shape[1]
        ]
        return inside.ravel().take(self.cell)

    def _places_in(self, part: tuple[slice, slice], cell: Cells) -> tuple[Cells, Cells]:
        """Which of the cells ``cell`` (k,) are in a part of the padded grid, and their places in it, flattened.

        The padded grid as a whole is never made: it would take the memory of the rectangle around the cells.
        """
        columns = self.shape[1]
        rows = max(part[0].start - self.radius, 0), max(part[0].stop - self.radius, 0)
        first, last = np.searchsorted(cell, (rows[0] * columns, rows[1] * columns)).tolist()
        near = cell[first:last]
        row = near // columns
        column = near - row * columns + self.radius - part[1].start
        line = part[1].stop - part[1].start
        inside = np.flatnonzero((column >= 0) & (column < line))
        return first + inside, (row[inside] + self.radius - part[0].start) * line + column[inside]

    def parts(self) -> Iterator[tuple[slice, tuple[slice, slice], Cells, Cells]]:
        """Which of the cells have windows in one part of the padded grid, that part, and its row and column where each
        window begins.
        """
        row = self.cell // self.shape[1]
        column = self.cell - row * self.shape[1]
        lines = self.lines
        for top in range(0, self.shape[0], lines):
            here = slice(*np.searchsorted(row, (top, top + lines)).tolist())
            if here.start < here.stop:
                i, j = row[here], column[here]
                left = int(j.min())
                i, j = i - top, j - left
                yield (
                    here,
                    (slice(top, top + int(i[-1]) + self.size), slice(left, left + int(j.max()) + self.size)),
                    i,
                    j,
                )


def _sums_by_numpy(
    wanted: Cells, cell: Cells, values: Float, grid_shape: tuple[int, int], radius: int, lines: int
) -> NDArray[Any]:
    del lines  # of a strip: the loop's alone
    return np.array(Windows(wanted, grid_shape, radius).totals_by_numpy(cell, *values))


_window_sums = compiled(_sums_by_numpy, *window_kernels.HELPERS)(window_kernels.window_sums)
