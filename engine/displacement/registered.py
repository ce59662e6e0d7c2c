"""The registration's error as motion that it feigns."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..core.arrays import Float
from ..geometry.rigid_transform import RigidTransform, registration_facts


@dataclass(frozen=True)
class Registered:
    """Error of a registration.

    ``covariance`` (6, 6) is of a turn (rotation vector about ``centre`` (3,), rad) and a shift (east, north, up; m);
    ``known`` is False where nobody stated it.
    """

    covariance: Float
    centre: Float
    known: bool

    @classmethod
    def unknown(cls) -> Registered:
        return cls(np.zeros((6, 6)), np.zeros(3), known=False)

    @classmethod
    def shift(cls, level: float, height: float) -> Registered:
        """From standard errors (m) of a shift in each horizontal direction and in height."""
        return cls(np.diag([0.0, 0.0, 0.0, level**2, level**2, height**2]), np.zeros(3), known=True)

    @classmethod
    def of_transform(cls, path: Path) -> Registered:
        """As the file of a transform states it; unknown where it does not.

        Raises:
            InputError: see ``RigidTransform.load``.
        """
        covariance = registration_facts(path).get("covariance")
        if covariance is None:
            return cls.unknown()
        return cls(np.array(covariance, dtype=np.float64), np.asarray(RigidTransform.load(path).centre), known=True)

    def turned_about(self, centre: Float) -> Registered:
        """What is left of the error where a common motion about ``centre`` (3,) was taken off: its turn."""
        covariance = np.zeros((6, 6))
        covariance[:3, :3] = self.covariance[:3, :3]
        return Registered(covariance, centre, self.known)

    def at(self, places: Float) -> Float:
        """(n, 3, 3) covariance of the motion that the error feigns at places (n, 3), m²."""
        arm = places - self.centre
        lever = np.zeros((len(places), 3, 6))
        lever[:, 0, 1], lever[:, 0, 2] = arm[:, 2], -arm[:, 1]
        lever[:, 1, 0], lever[:, 1, 2] = -arm[:, 2], arm[:, 0]
        lever[:, 2, 0], lever[:, 2, 1] = arm[:, 1], -arm[:, 0]
        lever[:, :, 3:] = np.eye(3)
        return np.asarray(lever @ self.covariance @ np.swapaxes(lever, 1, 2))
