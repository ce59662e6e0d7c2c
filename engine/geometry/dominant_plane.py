"""The dominant plane of a slope, and the rotation that lays it flat.

RANSAC finds the plane that most points agree with (Fischler and Bolles 1981, doi:10.1145/358669.358692), a principal
component analysis of these points refines it, and Rodrigues' formula gives the rotation of its normal to the vertical.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ..core.arrays import Float
from ..core.errors import InputError
from .columns import least
from .numbered import lowest_of_each

_MAX_VOTERS = 4000  # points that vote in RANSAC; the analysis uses all


@dataclass(frozen=True)
class Plane:
    """A plane in the cloud's coordinates.

    ``normal`` (3,) has unit length and points upwards; ``centroid`` (3,) lies on the plane, in metres;
    ``inlier_share`` is the share of the points within RANSAC's distance.
    """

    normal: Float
    centroid: Float
    inlier_share: float

    @property
    def dip(self) -> float:
        """Angle to the horizontal, degrees from 0 to 90."""
        return math.degrees(math.acos(min(1.0, max(-1.0, float(self.normal[2])))))

    @property
    def azimuth(self) -> float:
        """Direction of steepest descent, degrees clockwise from grid north (0 for a horizontal plane)."""
        east, north = float(self.normal[0]), float(self.normal[1])
        if math.hypot(east, north) < 1e-12:
            return 0.0
        return math.degrees(math.atan2(east, north)) % 360.0


def lowest_points(xyz: Float, cell: float) -> Float:
    """The lowest point of each occupied cell of a square grid of ``cell`` metres: mostly ground."""
    keys = np.floor((xyz[:, :2] - least(xyz[:, :2])) / cell).astype(np.int64)
    key = keys[:, 0] * (int(keys[:, 1].max()) + 1) + keys[:, 1]
    return xyz[lowest_of_each(key, xyz[:, 2])]


def fit_plane(xyz: Float, distance: float, iterations: int, seed: int) -> Plane:
    """Dominant plane of a cloud: RANSAC, then a principal component analysis of the points that agree.

    Args:
        xyz: (n, 3) coordinates in metres.
        distance: farthest distance (m) of a point that agrees with a plane.
        iterations: planes that RANSAC tries.
        seed: of the random choice; the same seed gives the same plane.

    Raises:
        InputError: fewer than three points, or all on one line.
    """
    if len(xyz) < 3:
        raise InputError(f"The slope's plane needs at least 3 points but there are {len(xyz)}; check the region.")
    generator = np.random.default_rng(seed)
    middle = xyz.mean(axis=0)
    local = xyz - middle
    voters = local
    if len(local) > _MAX_VOTERS:
        voters = local[np.sort(generator.choice(len(local), _MAX_VOTERS, replace=False))]
    corners = voters[generator.integers(0, len(voters), size=(iterations, 3))]
    sides = corners[:, 1:] - corners[:, :1]
    normals = np.cross(sides[:, 0], sides[:, 1])
    lengths = np.linalg.norm(normals, axis=1)
    sound = lengths > 1e-9 * np.linalg.norm(sides, axis=2).prod(axis=1)
    if not sound.any():
        raise InputError("The slope's plane cannot be found because the points lie on one line; check the region.")
    normals = normals[sound] / lengths[sound, None]
    offsets = np.einsum("ij,ij->i", normals, corners[sound, 0])
    votes = np.array([np.count_nonzero(np.abs(voters @ n - d) <= distance) for n, d in zip(normals, offsets)])
    best = int(np.argmax(votes))
    normal, centre = normals[best], normals[best] * offsets[best]
    inside = np.abs((local - centre) @ normal) <= distance
    # the analysis moves the plane a little, which changes who agrees; a few rounds settle it
    for _ in range(5):
        centre = local[inside].mean(axis=0)
        spread, axes = np.linalg.eigh(np.cov((local[inside] - centre).T, ddof=0))
        if spread[1] <= 1e-12 * max(spread[2], 1e-300):
            raise InputError("The slope's plane cannot be found because the points lie on one line; check the region.")
        normal = axes[:, 0]
        again = np.abs((local - centre) @ normal) <= distance
        if np.array_equal(again, inside) or np.count_nonzero(again) < 3:
            break
        inside = again
    if normal[2] < 0 or (normal[2] == 0 and tuple(normal) < (0.0, 0.0, 0.0)):
        normal = -normal
    return Plane(normal, middle + centre, float(np.count_nonzero(inside) / len(local)))


def rotation_to_vertical(normal: Float) -> Float:
    """Rodrigues' rotation (3, 3), about a horizontal axis, that turns the unit vector ``normal`` to (0, 0, 1)."""
    axis = np.array([normal[1], -normal[0], 0.0])  # normal x vertical
    sine, cosine = float(np.linalg.norm(axis)), float(normal[2])
    if sine < 1e-15:
        return np.eye(3) if cosine > 0 else np.diag([1.0, -1.0, -1.0])
    x, y, z = axis / sine
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + sine * cross + (1.0 - cosine) * (cross @ cross)


def flattening_matrix(plane: Plane) -> Float:
    """(4, 4) from the cloud's coordinates to the slope's frame: the plane is z = 0, its centroid the origin.

    The origin keeps coordinates small, because large ones cost the cloth simulation digits.
    """
    matrix = np.eye(4)
    matrix[:3, :3] = rotation_to_vertical(plane.normal)
    matrix[:3, 3] = -matrix[:3, :3] @ plane.centroid
    return matrix


def unflattening_matrix(plane: Plane) -> Float:
    """(4, 4), the inverse of ``flattening_matrix``: a rotation's inverse is its transpose, so no digits are lost."""
    matrix = np.eye(4)
    matrix[:3, :3] = rotation_to_vertical(plane.normal).T
    matrix[:3, 3] = plane.centroid
    return matrix


def apply_matrix(matrix: Float, xyz: Float) -> Float:
    """(n, 3) coordinates transformed by a rigid (4, 4) ``matrix``."""
    return np.asarray(xyz @ matrix[:3, :3].T + matrix[:3, 3], dtype=np.float64)
