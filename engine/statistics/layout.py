"""How values of a grid's cells are held: of all cells (rows, columns), or of a list of them only, (n,)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core.arrays import Index

Window = tuple[slice, ...]
_BAND_CELLS = 1_000_000  # cells of a grid's rows that are laid out at a time


@dataclass(frozen=True)
class Layout:
    """Arrays of a grid of ``shape`` (rows, columns), which hold all cells or those ``listed``.

    A slope that lies oblique to its grid fills a small part of the rectangle around it. Arrays (n,) of the listed
    cells take the memory and the time of the slope, arrays (rows, columns) those of the rectangle. The order is the
    same in both, so that what is chosen by a mask comes out alike. A *place* is the index of a value in the array,
    flattened; where all cells are held it is the flat index of the cell in the grid.

    Attributes:
        listed: (n,) flat indices of the cells that are held, ascending; None: all.
    """

    shape: tuple[int, int]
    listed: Index | None = None

    @property
    def array_shape(self) -> tuple[int, ...]:
        """Of the arrays that are held so."""
        return self.shape if self.listed is None else self.listed.shape

    def flat(self, place: Index) -> Index:
        """Flat index in the grid of each of the places (n,)."""
        return place if self.listed is None else self.listed[place]

    def row_and_column(self, place: Index) -> tuple[Index, Index]:
        """Of each of the places (n,)."""
        row, column = np.divmod(self.flat(place), self.shape[1])
        return row, column

    def of(self, whole: NDArray[Any]) -> NDArray[Any]:
        """The values of an array (rows, columns) that are held."""
        return whole if self.listed is None else whole.ravel()[self.listed]

    def on_grid(self, values: NDArray[Any], empty: Any = None) -> NDArray[Any]:
        """Values that are held on the grid (rows, columns); elsewhere ``empty``: NaN, 0 or False by their type."""
        if self.listed is None:
            return values
        whole = np.full(self.shape, _empty(values, empty), dtype=values.dtype)
        whole.ravel()[self.listed] = values
        return whole

    def window(self, values: NDArray[Any], window: Window, empty: Any = None) -> NDArray[Any]:
        """As ``on_grid``, some rows and columns of it."""
        if self.listed is None:
            return values[window]
        rows, columns = (range(*part.indices(size)) for part, size in zip(window, self.shape, strict=True))
        dense = np.full((len(rows), len(columns)), _empty(values, empty), dtype=values.dtype)
        starts = np.arange(rows.start, rows.stop) * self.shape[1]
        if len(columns) == self.shape[1]:
            here = slice(*np.searchsorted(self.listed, (rows.start * len(columns), rows.stop * len(columns))).tolist())
            dense.ravel()[self.listed[here] - rows.start * len(columns)] = values[here]
            return dense
        # row by row, since each row of a long slope holds many more cells than a small window does
        first, last = (np.searchsorted(self.listed, starts + column) for column in (columns.start, columns.stop))
        sizes = last - first
        place = np.arange(sizes.sum()) + np.repeat(first - (np.cumsum(sizes) - sizes), sizes)
        row = np.repeat(np.arange(len(rows)), sizes)
        dense[row, self.listed[place] - np.repeat(starts + columns.start, sizes)] = values[place]
        return dense

    def at(self, values: NDArray[Any], row: Index, column: Index, empty: Any = None) -> NDArray[Any]:
        """Values of the cells in the rows and columns (k,) of the grid; ``empty`` where a cell is not held."""
        if self.listed is None:
            return values[row, column]
        flat = row * self.shape[1] + column
        place = np.minimum(np.searchsorted(self.listed, flat), max(self.listed.size - 1, 0))
        if not self.listed.size:
            return np.full(flat.shape, _empty(values, empty), dtype=values.dtype)
        return np.where(self.listed[place] == flat, values[place], np.asarray(_empty(values, empty), values.dtype))

    def lines(self, values: NDArray[Any], rows: slice, empty: Any = None) -> NDArray[Any]:
        """As ``on_grid``, some rows of it."""
        return self.window(values, (rows, slice(None)), empty)

    def block_sums(self, values: NDArray[Any], side: int) -> NDArray[Any]:
        """Sums of whole numbers over square blocks of ``side`` cells, (block rows, block columns); the last ones may be
        cut by the grid's edge.
        """
        down, across = (-(-n // side) for n in self.shape)
        if self.listed is None:
            rows, columns = (np.arange(0, n, side) for n in self.shape)
            whole: NDArray[Any] = np.add.reduceat(np.add.reduceat(values, rows, axis=0), columns, axis=1)
            return whole
        row, column = np.divmod(self.listed, self.shape[1])
        total = np.bincount(row // side * across + column // side, values, minlength=down * across)
        return total.astype(values.dtype).reshape(down, across)


def bands(shape: tuple[int, int], cells: int = _BAND_CELLS) -> list[slice]:
    """The rows of a grid in bands of about so many ``cells``, at least a row, to be worked on one after the other."""
    height = max(cells // max(shape[1], 1), 1)
    return [slice(top, min(top + height, shape[0])) for top in range(0, shape[0], height)]


@dataclass(frozen=True)
class Laid:
    """Values with the layout that they are held in."""

    values: NDArray[Any]
    layout: Layout


def laid(values: NDArray[Any] | Laid) -> Laid:
    """With their layout; an array holds all cells (rows, columns)."""
    return values if isinstance(values, Laid) else Laid(values, layout_of(values))


def layout_of(whole: NDArray[Any]) -> Layout:
    """That of an array of all cells (rows, columns)."""
    return Layout((whole.shape[0], whole.shape[1]))


def _empty(values: NDArray[Any], empty: Any) -> Any:
    if empty is not None:
        return empty
    return np.nan if values.dtype.kind == "f" else values.dtype.type(0)
