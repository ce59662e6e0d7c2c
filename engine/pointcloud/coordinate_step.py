"""The real step of a cloud's coordinates: a file may hold more digits than its points have.

A cloud whose heights were rounded, or went through 32-bit numbers, lies on a lattice. The header's scale does not show
it, and the surface between the steps is lost.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ...interface.parameters import InputParameters
from ..core.arrays import Float
from ..core.errors import InputError
from ..core.messages import shown
from ..core.progress import Progress
from .reading import open_cloud
from .records import PLACES, read_records

MOST_STEP_M, WARNED_STEP_M = 0.1, 0.01
"""A larger step is refused; a larger one than the second gets a warning."""
_ROUNDING = 1.001
_STRETCHES = 3
_MAX_POINTS, _MIN_POINTS = 5000, 30
_MIN_LEVELS = 4
"""Different values on the lattice: fewer may be a few level surfaces."""
_MIN_SHARE = 0.7
"""Of the points that lie on the lattice."""
_MAX_FINER_SHARE = 0.1
"""Share of the points that a finer lattice holds in addition; with more, the finer one is the step."""
_TRIPLES, _MAX_DIVISORS = 3000, 8
_PARTS = (1.0, 0.5, 0.2, 0.1, 0.05, 0.02, 0.25, 0.125, 0.0625, 0.03125, 0.015625)
_UNITS_M = (1.0, 0.3048, 1200 / 3937)
"""Metre, foot and US survey foot. Steps that are parts of another unit, or of 32-bit numbers, are no whole number of
the file's steps."""
_MIN_GRID_POINTS = 0.1
_MAX_GRID_DOUBLES = 0.2
"""Points a node from which a grid can be told, and its share of the doubles that rounding at random makes."""
_BLOCK_NODES = 8
Integers = NDArray[np.int64]


def judge_steps(path: Path, steps: Sequence[float], progress: Progress) -> None:
    """Warn of a coarse step of x, y or z (m).

    Raises:
        InputError: one is larger than ``MOST_STEP_M``.
    """
    for axis, step in zip("xyz", steps, strict=True):
        if step > MOST_STEP_M * _ROUNDING:
            raise InputError(
                f"{shown(path)} has {axis} coordinates in steps of {step:.3g} m; export the survey again without "
                "rounding."
            )
        if step > WARNED_STEP_M * _ROUNDING:
            progress.warning(
                f"{shown(path)} has {axis} coordinates in steps of {step:.3g} m, which may hide or feign change; "
                "export the survey again in millimetres."
            )


def coordinate_step(path: Path, inputs: InputParameters | None = None) -> tuple[float, ...]:
    """Step of x, y and z in metres, found from a sample of the points.

    x and y of a regular grid have the step of the file's numbers: the grid is the spacing of its points.

    Raises:
        InputError: see ``open_cloud`` and ``read_records``.
    """
    header, frame = open_cloud(path, inputs)
    records = read_records(header, selection=PLACES, stretches=_STRETCHES)
    counts = np.concatenate([np.column_stack([part[axis] for axis in "XYZ"]) for part in records]).astype(np.int64)
    rng = np.random.default_rng(0)
    few = counts[rng.permutation(len(counts))[:_MAX_POINTS]]
    units = np.array(header.scales) * frame.factors
    origins = np.array(header.offsets) / header.scales
    steps = [_step(few[:, k], float(units[k]), float(origins[k]), rng) for k in range(3)]
    if min(steps[:2]) * min(units[:2]) > WARNED_STEP_M and _is_grid(counts[:, :2], np.array(steps[:2])):
        steps[:2] = [1.0, 1.0]
    return tuple(float(step * unit) for step, unit in zip(steps, units, strict=True))


def _step(values: Integers, unit: float, origin: float, rng: np.random.Generator) -> float:
    """The widest lattice that holds nearly all values (n,), in their own steps of ``unit`` metres; ``origin`` is what
    is added to them for the coordinates of the reference system.
    """
    if len(values) < _MIN_POINTS:
        return 1.0
    whole = [(float(width), _on_multiples(values)) for width in _divisors(values, rng)]
    parts = {part * metres / unit for metres in (*_UNITS_M, 1.0) for part in _PARTS}
    others = [(width, _on_parts(values, origin)) for width in parts if width * unit > WARNED_STEP_M and width > 8.0]
    for width, held_by in sorted((*whole, *others), key=lambda one: -one[0]):
        share, levels = held_by(width)
        if share < _MIN_SHARE or levels < _MIN_LEVELS:
            continue
        finer = max(held_by(width / part)[0] for part in (2.0, 3.0, 5.0))
        if finer - share <= _MAX_FINER_SHARE:
            return width
    return 1.0


def _divisors(values: Integers, rng: np.random.Generator) -> list[int]:
    """The most frequent greatest common divisors of differences between values (n,)."""
    one, two, three = values[rng.integers(0, len(values), (3, _TRIPLES))]
    found, votes = np.unique(np.gcd(one - two, one - three), return_counts=True)
    order = np.argsort(-votes, kind="stable")
    return [int(width) for width in found[order][:_MAX_DIVISORS] if width > 1]


Lattice = Callable[[float], tuple[float, int]]
"""From a width to the share of the values on the lattice beyond what is there by chance, and its levels in use."""


def _on_multiples(values: Integers) -> Lattice:
    def held(width: float) -> tuple[float, int]:
        if width != int(width):
            return 0.0, 0
        rest = values % int(width)
        kinds, counts = np.unique(rest, return_counts=True)
        on = values[rest == kinds[np.argmax(counts)]]
        return _beyond_chance(len(on) / len(values), 1.0 / width), len(np.unique(on))

    return held


def _on_parts(values: Integers, origin: float) -> Lattice:
    def held(width: float) -> tuple[float, int]:
        level = np.rint((values + origin) / width)
        on = np.abs(values + origin - level * width) <= 0.51
        return _beyond_chance(float(on.mean()), min(1.0, 1.02 / width)), len(np.unique(level[on]))

    return held


def _beyond_chance(share: float, chance: float) -> float:
    return (share - chance) / (1.0 - chance) if chance < 1.0 else 0.0


def _is_grid(xy: Integers, steps: Float) -> bool:
    """Whether points (n, 2) are the nodes of a grid: rounding puts several points on some nodes and none on others."""
    nodes = np.rint(xy / steps).astype(np.int64)
    blocks = len(np.unique(nodes // _BLOCK_NODES, axis=0))
    a_node = len(nodes) / (blocks * _BLOCK_NODES**2)
    doubles = 1.0 - len(np.unique(nodes, axis=0)) / len(nodes)
    by_chance = 1.0 - (1.0 - np.exp(-a_node)) / a_node
    return bool(a_node >= _MIN_GRID_POINTS and doubles <= _MAX_GRID_DOUBLES * by_chance)
