"""Whether a cloud is the bare ground of one slope, as screening takes it to be; refusals with their remedy."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...engine.core.arrays import Float
from ...engine.core.errors import InputError
from ...engine.core.progress import Progress
from ...engine.geometry.dominant_plane import Plane
from ...engine.geometry.plane_gradient import gradient_parts
from ...engine.grid.cell_statistics import cell_statistics
from ...engine.grid.grid import snapped_grid
from ...interface.parameters import ScreeningParameters
from .two_planes import ONE_PLANE, TwoPlanes, two_planes

_FACE_CELL_M = 4.0
"""Side (m) of the squares whose own dip says which way the ground faces; drains and berms are smaller."""
_MIN_FACE_DIP_DEG = 10.0
_MIN_FACE_SHARE = 0.25
"""Two opposite faces: each is at least this share of what dips at all."""
_MIN_PLANE_ANGLE_DEG = 15.0
_MAX_SCATTER_LEFT = 0.15
"""Two slopes: what two planes leave of the scatter about one. Where two planes meet it was 0.01 to 0.04, on 28 real and
simulated single slopes, gullied ones among them, 0.28 to 0.71."""
_MAX_BARE_SCATTER_M = 0.15
"""Scatter (m) about a plane within 1 m² beyond which it is not bare ground; see ADR 0005."""
_MAX_ROUGH_SHARE = 0.15
_MIN_CELL_POINTS = 6
_SPARSE, _SPARSE_CELL_M = 4.0, 3.0
"""Below so many points in the middle one of the square metres that have any, those without any count, too: the density
is then measured on squares of this side (m)."""
_SPARSER = {"network": "relief", "relief": "filter"}
"""Method that takes sparser ground than another."""
MIN_WIDTH_M = 4.0
"""The reach of the trend: in a narrower strip a hazard is most of the ground that its own height is measured from."""


@dataclass(frozen=True)
class Suitability:
    """What is measured before screening.

    ``dip`` (degrees) of the dominant plane; ``density``: points a m², those of the middle one of the slope's squares;
    ``opposite_share``: part of the dipping ground that faces against the rest (0 to 0.5); ``rough_share``:
    part of the square metres whose points scatter too much for bare ground; ``width`` (m) of the region on the slope,
    where it is narrowest; the two ``planes`` that describe it best.
    """

    dip: float
    density: float
    opposite_share: float
    rough_share: float
    width: float = math.inf
    planes: TwoPlanes = ONE_PLANE


def measure(xyz: Float, flat: Float, plane: Plane, thinned: float = 1.0) -> Suitability:
    """Measure a sample.

    Args:
        xyz: (n, 3) points in map coordinates, m. flat: the same in the frame of ``plane``.
        thinned: points of the cloud for each point of the sample.
    """
    bounds = (*flat[:, :2].min(axis=0).tolist(), *flat[:, :2].max(axis=0).tolist())
    cells = cell_statistics(flat, snapped_grid(bounds, 1.0), plane=True)
    judged = cells.points >= _MIN_CELL_POINTS
    rough = np.sqrt(cells.variance[judged]) > _MAX_BARE_SCATTER_M
    return Suitability(
        dip=plane.dip,
        density=_density(flat, cells.points, thinned),
        opposite_share=opposite_share(xyz),
        rough_share=float(rough.mean()) if judged.any() else 0.0,
        width=narrowest(flat),
        planes=two_planes(xyz),
    )


def _density(flat: Float, points: NDArray[np.integer], thinned: float) -> float:
    """Points a m² of the cloud of a sample (n, 3) in its flat frame, ``points`` (k,) of whose square metres are known,
    and each of which stands for ``thinned``.
    """
    density = float(np.median(points)) * thinned
    if density >= _SPARSE:
        return density
    place = np.floor((flat[:, :2] - flat[:, :2].min(axis=0)) / _SPARSE_CELL_M).astype(np.int64)
    number = np.unique(place, axis=0, return_counts=True)[1]
    return float(np.median(number)) * thinned / _SPARSE_CELL_M**2


def refuse_unsuitable(
    found: Suitability,
    parameters: ScreeningParameters,
    name: str,
    *,
    density: tuple[float, float] | None,
    classified: bool,
    bare: bool,
    progress: Progress,
) -> None:
    """Raise InputError if a cloud is not one slope, or (where ``ground`` is auto) not its bare ground.

    Args:
        name: of the cloud, for messages.
        density: least and most points a m² that the method was made for; None: any.
        classified: whether the cloud has points of class 2, so that they may be offered.
        bare: whether the points are known to be ground.
    """
    if found.opposite_share >= _MIN_FACE_SHARE:
        raise InputError(
            f"{name} has two opposite faces ({100 * found.opposite_share:.0f} % of its sloping ground faces against "
            "the rest), but screening takes one slope at a time; cut out one of them with --roi."
        )
    planes = found.planes
    if planes.share >= _MIN_FACE_SHARE and planes.angle >= _MIN_PLANE_ANGLE_DEG and planes.left <= _MAX_SCATTER_LEFT:
        raise InputError(
            f"{name} is two slopes (planes {planes.angle:.0f} degrees apart, with {100 - 100 * planes.share:.0f} and "
            f"{100 * planes.share:.0f} % of it, leave {100 * planes.left:.0f} % of the scatter about one), but "
            "screening takes one slope at a time; cut out one of them with --roi."
        )
    if found.width < MIN_WIDTH_M:
        raise InputError(
            f"{name} is {found.width:.1f} m wide on its slope where screening needs {MIN_WIDTH_M:g} m for the trend "
            "that heights refer to; give a larger region with --roi."
        )
    if found.dip < parameters.minimum_dip:
        raise InputError(
            f"{name} is no slope: its dominant plane dips {found.dip:.1f} degrees where screening needs "
            f"{parameters.minimum_dip:g}; cut out the slope with --roi, or lower minimum_dip."
        )
    if found.dip > parameters.maximum_dip:
        raise InputError(
            f"{name} is a wall: its dominant plane dips {found.dip:.1f} degrees where screening takes "
            f"{parameters.maximum_dip:g} at most; check the order of its coordinates, or raise maximum_dip."
        )
    if parameters.ground == "auto" and not bare and found.rough_share > _MAX_ROUGH_SHARE:
        ready = "--ground class_2 to take its points of class 2, " if classified else ""
        raise InputError(
            f"{name} is no bare ground ({100 * found.rough_share:.0f} % of its square metres scatter as plants do); "
            f"give --ground extract to extract the ground first, {ready}or --ground as_is if it is rough ground."
        )
    if density is not None and not density[0] <= found.density <= density[1]:
        sparse, method = found.density < density[0], parameters.screening_method
        sentence = (
            f"{name} has {_density_text(found.density)} points a m² where the method {method} was "
            f"made for {density[0]:g} to {density[1]:g}"
        )
        if not parameters.any_density:
            remedy = f"--screening-method {_SPARSER.get(method, 'residual')}" if sparse else "a thinned cloud"
            remedy += ", other weights" if method == "network" else ""
            raise InputError(f"{sentence}; give {remedy}, or any_density to screen it all the same.")
        progress.warning(f"{sentence}, so its labels are not to be relied on.")


def narrowest(flat: Float) -> float:
    """Width (m) of a strip in which points (n, 2 or 3) in the flat frame scatter as they do across their longest
    direction.
    """
    across = np.linalg.eigvalsh(np.cov(flat[:, :2].T))[0]
    return float(np.sqrt(12.0 * max(across, 0.0)))


def opposite_share(xyz: Float) -> float:
    """Part of the dipping ground that faces against the direction which most of it faces, within 45 degrees of it."""
    gradient, weight = _gradients(xyz)
    dips = np.hypot(*gradient.T) > math.tan(math.radians(_MIN_FACE_DIP_DEG))
    if not dips.any():
        return 0.0
    angle = np.arctan2(gradient[dips, 1], gradient[dips, 0])
    weight = weight[dips]
    candidates = np.arange(-math.pi, math.pi, math.pi / 18)
    facing = np.array([weight[_apart(angle, c) <= math.pi / 4].sum() for c in candidates])
    main = candidates[int(facing.argmax())]
    against = weight[_apart(angle, main + math.pi) <= math.pi / 4].sum()
    return float(against / weight.sum())


def _apart(angle: Float, other: float) -> Float:
    return np.abs((angle - other + math.pi) % (2 * math.pi) - math.pi)


def _gradients(xyz: Float) -> tuple[Float, Float]:
    """Gradient (n, 2) of the plane through the points of each square, and the number of its points (n,)."""
    cell = np.floor((xyz[:, :2] - xyz[:, :2].min(axis=0)) / _FACE_CELL_M).astype(np.int64)
    _, square, count = np.unique(
        cell[:, 0] * (int(cell[:, 1].max()) + 1) + cell[:, 1], return_inverse=True, return_counts=True
    )
    local = xyz - xyz.mean(axis=0)

    def mean(values: NDArray[np.float64]) -> Float:
        return np.bincount(square, weights=values) / count

    dx, dy, dz = (local[:, k] - mean(local[:, k])[square] for k in range(3))
    xx, yy, xy, xz, yz = (mean(a * b) for a, b in ((dx, dx), (dy, dy), (dx, dy), (dx, dz), (dy, dz)))
    *rise, determinant = gradient_parts(xx, yy, xy, xz, yz)
    sound = (count >= 10) & (determinant > 0.02 * (_FACE_CELL_M**2 / 12.0) ** 2)
    with np.errstate(divide="ignore", invalid="ignore"):
        slope = np.stack(rise, axis=1) / determinant[:, None]
    return slope[sound], count[sound].astype(np.float64)


def _density_text(density: float) -> str:
    """As many decimals as tell a density from a limit that it just passes."""
    return f"{density:.{1 if density >= 2 else 2}f}".rstrip("0").rstrip(".")
