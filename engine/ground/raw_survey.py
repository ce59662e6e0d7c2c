"""Whether a cloud is a bare surface or a raw survey with its plants; decided on a sample, before any long work.

Three witnesses, each enough alone. Points of plants fill balls that points of a surface, however steep, cross as a
sheet. A pulse that goes on after its echo hit something thin. And the file may name its plants. Closed grass is a
surface like any other; it is not distinguished from the ground below it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from laspy import DecompressionSelection
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from ...interface.parameters import InputParameters
from ..core.arrays import Float
from ..core.errors import InputError
from ..core.messages import shown
from ..pointcloud.reading import open_cloud
from ..pointcloud.records import PLACES, read_records
from .pdal_pipelines import GROUND, NOISE

PLANTS = (3, 4, 5)
"""Low, medium and high vegetation, where the file says so itself."""
_MIN_KNOWN_GROUND_SHARE = 0.995
_STRETCHES = 12
_MAX_LOOKED_AT_POINTS = _STRETCHES * 50_000  # as many as the stretches of a file without chunks hold
_SQUARE_SIDE_M, _SQUARE_STEP = (
    10.0,
    7,
)  # whole squares, so that balls are full; the step spreads them in both directions
_BALL_RADII_M = (0.5, 0.7)
"""Radii (m) of the balls; the first with enough points is taken. In larger ones the rock of a real cloud, thinned, was
as thick as plants, so thinner clouds are not judged by this."""
_MIN_BALL_POINTS = 12
_MAX_BALLS = 1000
_MIN_JUDGED_SHARE = 0.8
"""Share of the balls that hold enough points."""
_MIN_THICKNESS_RATIO = 0.25
"""Scatter across the best plane, in radii of the ball: 0.19 on a sharp edge of 90 degrees, 0.45 in a filled ball."""
MAX_THICK_SHARE, MAX_FOLLOWED_SHARE, MAX_PLANT_SHARE = 0.15, 0.05, 0.05
"""Shares beyond which a cloud is raw: see docs/ground.md for those of real and simulated clouds."""


@dataclass(frozen=True)
class Bareness:
    """Shares (0 to 1) of a sample.

    ``thick``: balls that points fill instead of crossing as a sheet, NaN where the cloud is too thin to decide;
    ``followed``: echoes that a later one of their pulse follows; ``plants``, ``ground``: points of these classes, of
    those that are not of a noise class.
    """

    thick: float
    followed: float
    plants: float
    ground: float

    @property
    def known_ground(self) -> bool:
        """Whether the file says that all its points are ground."""
        return self.ground >= _MIN_KNOWN_GROUND_SHARE

    def signs(self) -> list[str]:
        """What shows that the cloud is raw; empty where nothing does."""
        if self.known_ground:
            return []
        found = (
            (self.thick, MAX_THICK_SHARE, "of its surface is as thick as plants are"),
            (self.followed, MAX_FOLLOWED_SHARE, "of its echoes are followed by another of their pulse"),
            (self.plants, MAX_PLANT_SHARE, "of its points have the classes of plants"),
        )
        return [f"{100 * share:.0f} % {words}" for share, most, words in found if share > most]


def bareness(path: Path, inputs: InputParameters | None = None) -> Bareness:
    """Look at some stretches of a cloud's points, evenly over the file.

    Raises:
        InputError: see ``open_cloud``; damaged points.
    """
    header, frame = open_cloud(path, inputs)
    factors = np.array(frame.factors)
    xyz, labels, followed = [], [], []
    for records in read_records(header, selection=PLACES | DecompressionSelection.CLASSIFICATION, stretches=_STRETCHES):
        xyz.append(np.column_stack([records[axis] for axis in "XYZ"]) * (np.array(header.scales) * factors))
        labels.append(np.asarray(records["classification"]))
        number = np.asarray(records["return_number"])
        followed.append((number > 0) & (number < np.asarray(records["number_of_returns"])))
    return bareness_of(np.concatenate(xyz), np.concatenate(labels), np.concatenate(followed))


def bareness_of(xyz: Float, labels: NDArray[np.uint8] | None, followed: NDArray[np.bool_]) -> Bareness:
    """As ``bareness``, of points (n, 3) in metres; those of some squares where they are many.

    Args:
        labels: (n,) classes; None where they are not known.
        followed: (n,) echoes that a later one of their pulse follows.
    """
    label = np.zeros(len(xyz), np.uint8) if labels is None else labels
    square = np.floor(xyz[:, :2] / _SQUARE_SIDE_M).astype(np.int64)
    every = -(-len(xyz) // _MAX_LOOKED_AT_POINTS)
    counted = ~np.isin(label, NOISE) & ((square[:, 0] + _SQUARE_STEP * square[:, 1]) % every == 0)
    if not counted.any():
        return Bareness(np.nan, 0.0, 0.0, 0.0)
    label = label[counted]
    return Bareness(
        thick=thick_share(xyz[counted]),
        followed=float(followed[counted].mean()),
        plants=float(np.isin(label, PLANTS).mean()),
        ground=float((label == GROUND).mean()),
    )


def thick_share(xyz: Float, seed: int = 0) -> float:
    """Share of balls about points, one in a square metre, in which points (n, 3), m, are no sheet; NaN: too few points.

    The sheet may have any inclination.
    """
    rng = np.random.default_rng(seed)
    order = rng.permutation(len(xyz))
    square = np.floor(xyz[order, :2] - xyz[:, :2].min(axis=0)).astype(np.int64)
    _, first = np.unique((square[:, 0] << 32) + square[:, 1], return_index=True)
    middle = xyz[rng.permutation(order[first])[:_MAX_BALLS]]
    tree = cKDTree(xyz)
    for radius in _BALL_RADII_M:
        count = tree.query_ball_point(middle, radius, return_length=True)
        judged = count >= _MIN_BALL_POINTS
        if judged.mean() >= _MIN_JUDGED_SHARE:
            balls = tree.query_ball_point(middle[judged], radius)
            return float(np.mean([_thickness(xyz[ball]) > _MIN_THICKNESS_RATIO * radius for ball in balls]))
    return float("nan")


def _thickness(points: Float) -> float:
    """Scatter (m) of points (n, 3) across the plane that fits them best."""
    local = points - points.mean(axis=0)
    return float(np.sqrt(max(0.0, np.linalg.eigvalsh(local.T @ local / (len(local) - 1))[0])))


def refuse_raw(paths: Sequence[Path], ground: str, inputs: InputParameters | None = None) -> None:
    """Raise InputError if one of the clouds is a raw survey and ``ground`` is auto.

    Args:
        ground: as of ``SurfaceParameters``.
    """
    if ground != "auto":
        return
    for path in paths:
        refuse_signs(path, bareness(path, inputs))


def refuse_signs(path: Path, found: Bareness) -> None:
    """Raise InputError if the points of ``path`` are those of a raw survey."""
    signs = found.signs()
    if signs:
        ready = "--ground class_2 to take the points of class 2, or " if found.ground > 0 else ""
        raise InputError(
            f"{shown(path)} is no bare ground ({' and '.join(signs)}); extract the ground of both surveys with "
            f"slopewatch ground first, or give the raw ones to slopewatch inspect, or give {ready}--ground as_is "
            "if it is a bare surface."
        )


def taken_as_ground(labels: NDArray[np.uint8] | None, ground: str, path: Path) -> NDArray[np.bool_] | None:
    """Which points (n,) of a cloud are taken; None: all.

    Raises:
        InputError: the points of class 2 are asked for, and there is none.
    """
    if ground != "class_2":
        return None
    mask = np.zeros(0, dtype=bool) if labels is None else labels == GROUND
    if not mask.any():
        raise InputError(
            f"{shown(path)} has no points of class 2; extract its ground with slopewatch ground, or leave out --ground."
        )
    return None if mask.all() else mask
