"""Small rigid motions in local coordinates, and their vectors for least squares."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from ..core.arrays import Float


@dataclass(frozen=True)
class Pose:
    """x' = rotation x + translation in coordinates near the origin."""

    rotation: Float
    translation: Float

    @classmethod
    def identity(cls) -> Pose:
        return cls(np.eye(3), np.zeros(3))

    @classmethod
    def from_vector(cls, vector: Float, radius: float) -> Pose:
        """From (rotation vector in radians x ``radius``, translation) (6,): all six numbers are metres."""
        return cls(Rotation.from_rotvec(vector[:3] / radius).as_matrix(), vector[3:].copy())

    def vector(self, radius: float) -> Float:
        """The inverse of ``from_vector``."""
        turn = Rotation.from_matrix(self.rotation).as_rotvec()
        return np.concatenate([turn * radius, self.translation])

    def apply(self, xyz: Float) -> Float:
        moved: Float = turned(xyz, self.rotation) + self.translation
        return moved

    def undo(self, xyz: Float) -> Float:
        moved: Float = turned(xyz - self.translation, self.rotation.T)
        return moved

    def moved(self, vector: Float, radius: float) -> Pose:
        """This motion, then the small motion ``vector``; orthonormal to the last digit however often it is called."""
        step = Pose.from_vector(vector, radius)
        rotation = Rotation.from_matrix(step.rotation @ self.rotation).as_matrix()
        return Pose(rotation, step.rotation @ self.translation + step.translation)


def turned(vectors: Float, rotation: Float) -> Float:
    """``vectors`` (n, 3) by a matrix (3, 3), without the threads of a matrix product, which cost more than they do."""
    return np.einsum("ij,kj->ik", vectors, rotation)
