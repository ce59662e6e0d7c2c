"""Sums over square windows of cells, and planes through them, as loops that numba compiles.

They add in the order of ``window_sums.slide``, so that the sums are numpy's to the last bit. A part of the grid at a
time is laid out, flattened; its lines are summed along while they are in the processor's nearest cache, and then across
in strips of ``_STRIP`` columns.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core.arrays import Float, Index

Numbers = NDArray[Any]
Whole = NDArray[np.int32]
Strip = tuple[int, int]
"""First column of a part, and the one after the last."""
Origin = tuple[int, int, int]
"""Flat index of the first cell that may be wanted, cells from row to row, and the windows' radius."""
_STRIP = 16  # columns: three copies of some 70 lines stay in the nearest cache


def slide_into(joined: Numbers, cells: Numbers, spare: Numbers, size: int, step: int) -> None:
    """``slide(cells, size, step)`` in the first places of ``joined``; ``cells`` and ``spare`` are written over."""
    left = cells.size
    length, start, width, fresh = left - (size - 1) * step, 0, 1, True
    to = joined[:length]
    while 4 * width <= size:
        if size & width:
            part = cells[start * step : start * step + length]
            if fresh:
                for k in range(length):
                    to[k] = part[k]
                fresh = False
            else:
                for k in range(length):
                    to[k] += part[k]
            start += width
        left -= width * step
        before, behind, doubled = cells[:left], cells[width * step : width * step + left], spare[:left]
        for k in range(left):
            doubled[k] = before[k] + behind[k]
        cells, spare = spare, cells
        width *= 2
    # what is left are windows of a width, if at all, and of twice that, which need not be kept
    part = cells[start * step : start * step + length]
    if size == 1:
        for k in range(length):
            to[k] = part[k]
        return
    if size & width:
        start += width
    one, two = (
        cells[start * step : start * step + length],
        cells[(start + width) * step : (start + width) * step + length],
    )
    if size & width and fresh:
        for k in range(length):
            to[k] = part[k] + (one[k] + two[k])
    elif size & width:
        for k in range(length):
            to[k] = (to[k] + part[k]) + (one[k] + two[k])
    elif fresh:
        for k in range(length):
            to[k] = one[k] + two[k]
    else:
        for k in range(length):
            to[k] = to[k] + (one[k] + two[k])


def along_into(found: Numbers, grid: Numbers, shape: tuple[int, int], size: int, power: int, spare: Numbers) -> None:
    """Sums over ``size`` cells each of the lines of ``grid``, of ``shape`` (lines, columns); (lines, fewer columns).

    Each column is multiplied by its number as often as ``power`` says. ``spare`` (2, columns) is written over.
    """
    width = shape[1] - size + 1
    for i in range(shape[0]):
        line, cells = grid[i * shape[1] : (i + 1) * shape[1]], spare[0, : shape[1]]
        if power == 0:
            for k in range(shape[1]):
                cells[k] = line[k]
        else:
            for k in range(shape[1]):
                cells[k] = line[k] * k
        slide_into(found[i * width : (i + 1) * width], cells, spare[1], size, 1)


def across_into(
    total: Numbers,
    along: Numbers,
    shape: tuple[int, int],
    strip: tuple[int, int],
    size: int,
    power: int,
    spare: Numbers,
) -> None:
    """Sums over ``size`` lines each of the columns ``strip`` of ``along``, of ``shape`` (lines, columns), line by line.

    Each line is multiplied by its number as often as ``power`` says. ``spare`` (2, lines of a strip) is written over.
    """
    wide = strip[1] - strip[0]
    cells = spare[0, : shape[0] * wide]
    for i in range(shape[0]):
        line, to = along[i * shape[1] + strip[0] : i * shape[1] + strip[1]], cells[i * wide : (i + 1) * wide]
        if power == 0:
            for k in range(wide):
                to[k] = line[k]
        else:
            for k in range(wide):
                to[k] = line[k] * i
    slide_into(total, cells, spare[1], size, wide)


def part_from(wanted: Index, first: int, top: int, lines: int, columns: int) -> tuple[int, int, int, int]:
    """Which of the cells ``wanted`` from ``first`` on are in ``lines`` rows from ``top`` on: the end of them, their
    lowest and highest column, and how many rows there are down to the last of them.
    """
    last, left, right, row = first, columns, 0, top
    while last < wanted.size and wanted[last] < (top + lines) * columns:
        while wanted[last] >= (row + 1) * columns:
            row += 1
        column = wanted[last] - row * columns
        left, right = min(left, column), max(right, column)
        last += 1
    return last, left, right, row - top + 1


def row_starts(wanted: Index, top: int, rows: int, columns: int) -> Index:
    """(rows + 1,) the first of the cells ``wanted`` in each row from ``top`` on, and the end of them."""
    found = np.empty(rows + 1, np.int64)
    for i in range(rows + 1):
        found[i] = np.searchsorted(wanted, (top + i) * columns)
    return found


def lay_out(
    grids: Float, cell: Index, values: Float, corner: tuple[int, int], shape: tuple[int, int], columns: int
) -> None:
    """Put ``values`` (fields, k) of the cells ``cell`` (k,) into parts, of ``shape`` and flattened; 0 elsewhere.

    ``corner`` is the first row and column of the parts.
    """
    for f in range(len(grids)):
        grids[f, : shape[0] * shape[1]] = 0.0
    row = max(corner[0], 0)
    k = np.searchsorted(cell, row * columns)
    while k < cell.size and cell[k] < (corner[0] + shape[0]) * columns:
        while cell[k] >= (row + 1) * columns:
            row += 1
        column = cell[k] - row * columns - corner[1]
        if 0 <= column < shape[1]:
            for f in range(len(grids)):
                grids[f, (row - corner[0]) * shape[1] + column] = values[f, k]
        k += 1


def window_sums(
    wanted: Index, cell: Index, values: Float, grid_shape: tuple[int, int], radius: int, lines: int
) -> Float:
    """Sums (fields, n) over the windows around the cells ``wanted`` of ``values`` (fields, k) at the cells ``cell``.

    Args:
        wanted, cell: (n,) and (k,), ascending.
        grid_shape: rows and columns of the grid; a window has 2 ``radius`` + 1 cells a side.
        lines: rows of the grid that are worked on at a time.
    """
    columns, size, found = grid_shape[1], 2 * radius + 1, np.empty((len(values), wanted.size))
    lines = min(lines, grid_shape[0])
    most = (lines + 2 * radius, columns + 2 * radius)
    grids, along = np.empty((len(values), most[0] * most[1])), np.empty(most[0] * columns)
    lined, stripped, total = np.empty((2, most[1])), np.empty((2, most[0] * _STRIP)), np.empty(lines * _STRIP)
    first = 0
    while first < wanted.size:
        top = wanted[first] // columns // lines * lines
        last, left, right, height = part_from(wanted, first, top, lines, columns)
        width = right - left + 1
        shape = (height + 2 * radius, width + 2 * radius)
        lay_out(grids, cell, values, (top - radius, left - radius), shape, columns)
        starts = row_starts(wanted, top, height, columns)
        for f in range(len(values)):
            at = starts.copy()
            along_into(along, grids[f], shape, size, 0, lined)
            for begin in range(0, width, _STRIP):
                end = min(begin + _STRIP, width)
                across_into(total, along, (shape[0], width), (begin, end), size, 0, stripped)
                for i in range(height):
                    k, origin = at[i], (top + i) * columns + left
                    while k < last and wanted[k] < origin + end:
                        found[f, k] = total[i * (end - begin) + wanted[k] - origin - begin]
                        k += 1
                    at[i] = k
        first = last
    return found


def next_line(columns: Whole, leaving: Whole, entering: Whole, radius: int) -> None:
    """Move ``columns`` (3, line), sums over windows of 2 ``radius`` + 1 lines of 1, b and b b, down by one line.

    b is the line from the window's middle downwards; ``leaving`` and ``entering`` (line,) are the lines that do.
    """
    n, first, second = columns[0], columns[1], columns[2]
    for k in range(n.size):
        none = n[k] - leaving[k]
        once, twice = first[k] + radius * leaving[k], second[k] - radius * radius * leaving[k]
        n[k] = none + entering[k]
        first[k] = once - none + radius * entering[k]
        second[k] = twice - 2 * once + none + radius * radius * entering[k]


def running(found: Whole, columns: Whole) -> None:
    """Sums of ``columns`` (3, line) before each column, (line + 1, 6), modulo 2^32.

    Of 1, j, j j, b, b j and b b, with j the column and b as in ``next_line``.
    """
    n, j, jj, b, bj, bb = 0, 0, 0, 0, 0, 0
    found[0] = 0
    for k in range(columns.shape[1]):
        one, other = columns[0, k], columns[1, k]
        n, j, jj = n + one, j + k * one, jj + k * k * one
        b, bj, bb = b + other, bj + k * other, bb + columns[2, k]
        to = found[k + 1]
        to[0], to[1], to[2], to[3], to[4], to[5] = n, j, jj, b, bj, bb


def add_places(
    sums: Float, places: Float, wanted: Index, lines: Index, known: Whole, line: int, origin: Origin
) -> None:
    """Add the number of known cells, and sums of products of their places about their means, to ``sums`` (6, n).

    ``places`` (3, n) become the number, and the sums of the places from the cell at the middle, east and north.

    Args:
        wanted: cells (n,) of which those of each row of the part begin at ``lines`` (rows + 1,).
        known: the part, flattened, with ``line`` cells a line: 1 where a cell is known.
    """
    start, step, radius = origin
    size, columns, before = 2 * radius + 1, np.zeros((3, line), np.int32), np.empty((line + 1, 6), np.int32)
    leaving = np.zeros(line, np.int32)
    for i in range(size - 1):
        next_line(columns, leaving, known[i * line : (i + 1) * line], radius)
    for i in range(lines.size - 1):
        next_line(columns, leaving, known[(i + size - 1) * line : (i + size) * line], radius)
        leaving = known[i * line : (i + 1) * line]
        if lines[i] == lines[i + 1]:
            continue
        running(before, columns)
        for k in range(lines[i], lines[i + 1]):
            first = wanted[k] - start - i * step
            low, high, c = before[first], before[first + size], first + radius
            n, j, b = np.int32(high[0] - low[0]), high[1] - low[1], np.int32(high[3] - low[3])
            # small whole numbers in the end, exact modulo 2^32
            x, y = np.int32(j - c * n), -b
            xx = np.int32(high[2] - low[2] - 2 * c * j + c * c * n)
            xy, yy = np.int32(c * b - (high[4] - low[4])), np.int32(high[5] - low[5])
            mean = 1.0 / max(float(n), 1.0)
            sums[0, k] += n
            sums[1, k] += xx - x * (x * mean)
            sums[2, k] += yy - y * (y * mean)
            sums[3, k] += xy - x * (y * mean)
            places[0, k], places[1, k], places[2, k] = n, x, y


def add_heights(sums: Float, places: Float, wanted: Index, at: Index, strip: Strip, z: Float, origin: Origin) -> None:
    """Add the sums of products of places and heights about their means, of a strip of windows, to ``sums`` (6, n).

    Args:
        at: the first wanted cell of each line, and the end of them; moved on to the first beyond the strip.
        z: (3, lines of a strip) sums of z, of z times the line's number, and times the column's.
    """
    start, step, radius = origin
    last = at[-1]
    for i in range(at.size - 1):
        k, first = at[i], start + i * step
        while k < last and wanted[k] < first + strip[1]:
            place = i * (strip[1] - strip[0]) + wanted[k] - first - strip[0]
            column, row = float(wanted[k] - first + radius), float(i + radius)
            total, mean = z[0, place], 1.0 / max(places[0, k], 1.0)
            sums[4, k] += (z[2, place] - column * total) - total * (places[1, k] * mean)
            sums[5, k] += (row * total - z[1, place]) - total * (places[2, k] * mean)
            k += 1
        at[i] = k


def solve(sums: Float) -> Float:
    """(2, n) gradient of the planes of ``sums`` (6, n), as ``cell_slope._solved``; NaN where none is fixed."""
    found = np.empty((2, sums.shape[1]))
    for k in range(sums.shape[1]):
        cells, xx, yy, xy, xz, yz = sums[0, k], sums[1, k], sums[2, k], sums[3, k], sums[4, k], sums[5, k]
        determinant = xx * yy - xy * xy
        fixed = cells > 2.5 and determinant > 1e-3 * ((xx + yy) * (xx + yy))
        factor = 1.0 / (determinant if fixed else np.nan)
        found[0, k] = (xz * yy - yz * xy) * factor
        found[1, k] = (yz * xx - xz * xy) * factor
    return found


def window_planes(
    wanted: Index, surfaces: tuple[Index, Float, Index], grid_shape: tuple[int, int], radius: int, lines: int
) -> Float:
    """(2, n) gradient east and north, per cell, of the plane through the cells in the windows around ``wanted`` (n,).

    Args:
        surfaces: cells of all surfaces, each surface's ascending; their heights about the surface's mean; where each
            surface begins, and the end.
        grid_shape, lines: as in ``window_sums``.
    """
    columns, size = grid_shape[1], 2 * radius + 1
    sums, places = np.zeros((6, wanted.size)), np.empty((3, wanted.size))
    cell, height, starts = surfaces
    values = np.ones((2, cell.size))
    values[0] = height
    lines = min(lines, grid_shape[0])
    room, deep = (lines + 2 * radius) * (columns + 2 * radius), (lines + 2 * radius) * _STRIP
    grids, along, known = np.empty((2, room)), np.empty((2, room)), np.empty(room, np.int32)
    lined, stripped, z = np.empty((2, columns + 2 * radius)), np.empty((2, deep)), np.empty((3, deep))
    first = 0
    while first < wanted.size:
        top = wanted[first] // columns // lines * lines
        last, left, right, rows = part_from(wanted, first, top, lines, columns)
        width = right - left + 1
        shape, kept = (rows + 2 * radius, width + 2 * radius), (rows + 2 * radius, width)
        origin = (top * columns + left, columns, radius)
        for s in range(starts.size - 1):
            own, corner = cell[starts[s] : starts[s + 1]], (top - radius, left - radius)
            lay_out(grids, own, values[:, starts[s] : starts[s + 1]], corner, shape, columns)
            at = row_starts(wanted, top, rows, columns)
            known[: shape[0] * shape[1]] = grids[1, : shape[0] * shape[1]]
            add_places(sums, places, wanted, at, known, shape[1], origin)
            for power in range(2):
                along_into(along[power], grids[0], shape, size, power, lined)
            for begin in range(0, width, _STRIP):
                strip = (begin, min(begin + _STRIP, width))
                across_into(z[0], along[0], kept, strip, size, 0, stripped)
                across_into(z[1], along[0], kept, strip, size, 1, stripped)
                across_into(z[2], along[1], kept, strip, size, 0, stripped)
                add_heights(sums, places, wanted, at, strip, z, origin)
        first = last
    return solve(sums)


HELPERS = (
    slide_into, along_into, across_into, part_from, row_starts, lay_out,
    next_line, running, add_places, add_heights, solve,
)  # fmt: skip
"""Of both loops, each after those that it calls."""
