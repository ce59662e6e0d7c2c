"""Motion between two surveys of a series, in windows that are the same for all of its pairs."""

from __future__ import annotations

from dataclasses import dataclass, fields
from functools import cached_property
from pathlib import Path

import numpy as np

from ....interface.parameters import DisplacementParameters
from ...core.arrays import Float, Index
from ...core.errors import InputError
from ...core.progress import Progress
from ...displacement.displacement import measure_windows, windows_of
from ...displacement.facets import Facets, find_facets
from ...displacement.measure import Windows
from ...displacement.stored_ground import Ground
from ...displacement.surface import kernel_of
from ...displacement.windows import Search, density
from ...grid.grid import Grid


@dataclass(frozen=True)
class Layout:
    """The windows of a series, which lie over the ground of its first survey.

    ``cell`` (n,) is the flat index in ``grid`` of each window, ``facet`` (n,) its facet, ``places`` (n, 3) its middle.
    """

    grid: Grid
    cell: Index
    facets: Facets
    facet: Index
    places: Float

    @cached_property
    def axes(self) -> Float:
        """(n, 3, 3) of each window's facet, row by row in the map's coordinates."""
        return np.stack([frame.axes for frame in self.facets.frames])[self.facet]

    @cached_property
    def columns(self) -> Index:
        """(n, 2) column and row of each window, rows counted from the south."""
        row, column = np.divmod(self.cell, self.grid.columns)
        return np.column_stack([column, self.grid.rows - 1 - row])

    @cached_property
    def number(self) -> Index:
        """(cells,) number of the window of each cell of the grid, -1 for none."""
        found = np.full(self.grid.rows * self.grid.columns, -1, dtype=np.int64)
        found[self.cell] = np.arange(len(self.cell))
        return found


@dataclass(frozen=True)
class PairMotion:
    """Windows of each width between two surveys, the narrowest first, and the kernel's standard deviation (m)."""

    sizes: tuple[Windows, ...]
    kernel: float

    def save(self, path: Path) -> None:
        """Write as compressed NumPy arrays."""
        arrays = {f"{f.name}_{n}": getattr(w, f.name) for n, w in enumerate(self.sizes) for f in fields(Windows)}
        with path.open("wb") as file:
            np.savez_compressed(file, kernel=self.kernel, widths=len(self.sizes), **arrays)

    @classmethod
    def load(cls, path: Path) -> PairMotion:
        """What ``save`` wrote.

        Raises:
            InputError: it is no such file.
        """
        try:
            with np.load(path, allow_pickle=False) as stored:
                sizes = []
                for number in range(int(stored["widths"])):
                    values = {f.name: stored[f"{f.name}_{number}"] for f in fields(Windows)}
                    sizes.append(Windows(**values | {"radius": float(values["radius"])}))
                return cls(tuple(sizes), float(stored["kernel"]))
        except (OSError, ValueError, KeyError, TypeError) as error:
            raise InputError(f"{path} cannot be read; remove the folder {path.parent} and run again.") from error


def layout_of(first: Ground, parameters: DisplacementParameters) -> Layout:
    """The windows over the ground points (n, 3) of the first survey.

    Raises:
        InputError: there are too few points for a plane anywhere.
    """
    facets = find_facets(first)
    grid, cell, facet, places = windows_of(first, first, facets, parameters.spacing)
    return Layout(grid, cell, facets, facet, places)


def search_of(parameters: DisplacementParameters, kernel: float) -> Search:
    """How to look for motion, in windows of both widths."""
    radii = [parameters.window / 2]
    if parameters.wide_window > parameters.window:
        radii.append(parameters.wide_window / 2)
    return Search(tuple(radii), parameters.largest_motion, kernel)


def measure_pair(
    first: Ground,
    later: Ground,
    layout: Layout,
    parameters: DisplacementParameters,
    progress: Progress,
    threads: int | None = None,
) -> PairMotion:
    """Motion of ``later`` against ``first``, both ground points (n, 3) in the frame of the series, metres.

    Args:
        threads: tiles at a time, as of ``measure_displacement``.
    """
    kernel = kernel_of(density((first, later)))
    at = layout.places, layout.facet
    sizes, _ = measure_windows(first, later, layout.facets, at, search_of(parameters, kernel), progress, threads)
    return PairMotion(tuple(sizes), kernel)
