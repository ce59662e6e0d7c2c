"""The error of a difference of elevation models in each cell, from what the terrain is like there.

After Hugonnet et al. (2022, doi:10.1109/JSTARS.2022.3188922): the scatter (NMAD) of the difference on stable ground in
classes of the terrain's attributes, interpolated between them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise, product
from typing import Any

import numpy as np
from scipy.interpolate import RegularGridInterpolator

from ..core.arrays import Bool, Float, Index
from ..statistics.nearest_known import nearest_known
from ..statistics.robust import nmad

MIN_CELLS = 1000
"""Stable cells, below which one scatter stands for all cells."""
_MIN_CLASS_CELLS = 80  # an NMAD of so many is known to a tenth
_CELLS_A_CLASS = 250  # wanted on average
_MAX_CLASSES = 8  # of one attribute
_TAIL_SHARES = (0.95, 0.99)  # steep and rough ground is rare, and errs most
_MIN_RATIO = 0.25  # of the scatter of all: no class is believed to be better


@dataclass(frozen=True)
class CellErrors:
    """Standard error by classes of the attributes.

    Attributes:
        names: of the attributes.
        centres: of each attribute, the medians of its classes, ascending.
        scatter: (classes of the first, of the second, ...) NMAD of the stable cells of a class, metres; that of the
            nearest class where a class has too few.
        typical: NMAD of all stable cells, metres: where an attribute is unknown, and everywhere without classes.
        floor: what heights in steps err at least, metres.
        cells: number of stable cells.
    """

    names: tuple[str, ...]
    centres: tuple[Float, ...]
    scatter: Float
    typical: float
    floor: float
    cells: int

    def at(self, attributes: Sequence[Float]) -> Float:
        """The standard error of cells with these attributes (each of one shape), metres; linear between the classes'
        medians, constant beyond.
        """
        known = np.logical_and.reduce([np.isfinite(values) for values in attributes])
        error = np.full(known.shape, self.typical)
        if self.names:
            places = [
                np.clip(values[known], centres[0], centres[-1])
                for values, centres in zip(attributes, self.centres, strict=True)
            ]
            error[known] = RegularGridInterpolator(self.centres, self.scatter)(np.stack(places, axis=-1))
        return np.maximum(error, self.floor)


def cell_errors(dz: Float, attributes: dict[str, Float], stable: Bool, floor: float = 0.0) -> CellErrors:
    """Classes of equal numbers of ``stable`` cells along each attribute, as many as their number allows.

    Args:
        dz: difference (rows, columns), metres, NaN where unknown.
        attributes: by their names, each (rows, columns).
        floor: metres, see ``CellErrors``.
    """
    known = stable & np.isfinite(dz) & np.logical_and.reduce([np.isfinite(a) for a in attributes.values()])
    values = dz[known]
    middle = float(np.median(values)) if values.size else 0.0
    typical = max(nmad(values, middle), floor) if values.size else floor
    if values.size < MIN_CELLS:
        return CellErrors((), (), np.empty(0), typical, floor, int(values.size))
    each = int(min((values.size / _CELLS_A_CLASS) ** (1.0 / len(attributes)), _MAX_CLASSES))
    numbers, centres = [], []
    for attribute in attributes.values():
        number, middles = _classes(attribute[known], each)
        numbers.append(number)
        centres.append(middles)
    kept = {name: i for i, name in enumerate(attributes) if len(centres[i]) > 1}
    if not kept:
        return CellErrors((), (), np.empty(0), typical, floor, int(values.size))
    shape = tuple(len(centres[i]) for i in kept.values())
    flat = np.ravel_multi_index(tuple(numbers[i] for i in kept.values()), shape)
    scatter = _scatter(values - middle, flat, shape)
    return CellErrors(
        tuple(kept),
        tuple(centres[i] for i in kept.values()),
        np.maximum(scatter, max(floor, _MIN_RATIO * typical)),
        typical,
        floor,
        int(values.size),
    )


def _classes(values: Float, count: int) -> tuple[Index, Float]:
    """The class of each of the values (n,), and the classes' medians, which differ."""
    shares = np.linspace(0.0, 1.0, max(count - len(_TAIL_SHARES), 2) + 1)[1:-1]
    edges = np.unique(np.quantile(values, [*shares, *_TAIL_SHARES]))
    number = np.searchsorted(edges, values, side="right")
    # where many values are equal, a class may hold none or two the same middle
    present, number = np.unique(number, return_inverse=True)
    middles = np.array([np.median(values[number == i]) for i in range(len(present))])
    middles, merged = np.unique(middles, return_inverse=True)
    return merged[number], middles


def _scatter(values: Float, flat: Index, shape: tuple[int, ...]) -> Float:
    """NMAD about zero of each class; that of the nearest one where cells are too few."""
    order = np.argsort(flat, kind="stable")
    starts = np.searchsorted(flat[order], np.arange(int(np.prod(shape)) + 1))
    scatter = np.full(int(np.prod(shape)), np.nan)
    for number, (first, last) in enumerate(pairwise(starts.tolist())):
        if last - first >= _MIN_CLASS_CELLS:
            scatter[number] = nmad(values[order[first:last]], 0.0)
    grid = scatter.reshape(shape)
    known = np.isfinite(grid)
    if not known.any():
        return np.full(shape, nmad(values, 0.0))
    return np.asarray(grid[nearest_known(known)])


def attribute_table(errors: CellErrors, dz: Float, attributes: dict[str, Float], stable: Bool) -> list[dict[str, Any]]:
    """Of each attribute in quarters of the stable cells: its range, the cells, their NMAD and the mean error stated."""
    rows = []
    stated = (
        errors.at([attributes[name] for name in errors.names]) if errors.names else np.full(dz.shape, errors.typical)
    )
    for name, quarter in product(attributes, range(4)):
        values = attributes[name]
        known = stable & np.isfinite(dz) & np.isfinite(values)
        if not known.any():
            continue
        low, high = np.quantile(values[known], [quarter / 4, (quarter + 1) / 4])
        here = known & (values >= low) & (values <= high)
        rows.append(
            {
                "attribute": name,
                "from": float(low),
                "to": float(high),
                "cells": int(here.sum()),
                "nmad_m": nmad(dz[here]),
                "stated_m": float(np.median(stated[here])),
            }
        )
    return rows
