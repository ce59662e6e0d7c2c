"""The registration's error as motion that it feigns."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from ..core.arrays import Float
from ..geometry.rigid_transform import RigidTransform, registration_facts


@dataclass(frozen=True)
class Registered:
    """Error of a registration.

    ``covariance`` (6, 6) is of a turn (rotation vector about ``centre`` (3,), rad) and a shift (east, north, up; m);
    ``known`` is False where nobody stated it; ``taken_off`` (3, 3) is what is taken off the motion that a turn feigns.
    """

    covariance: Float
    centre: Float
    known: bool
    taken_off: Float = field(default_factory=lambda: np.zeros((3, 3)))

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

    def turned_about(self, centre: Float, taken_off: Float | None = None) -> Registered:
        """What is left of the error where a common motion about ``centre`` (3,) was taken off: its turn.

        ``taken_off`` (3, 3) is of that motion by a turn about the centre (``CommonMotion.by_turn``).
        """
        covariance = np.zeros((6, 6))
        covariance[:3, :3] = self.covariance[:3, :3]
        return Registered(covariance, centre, self.known, np.zeros((3, 3)) if taken_off is None else taken_off)

    def at(self, places: Float) -> Float:
        """(n, 3, 3) covariance of the motion that the error feigns at places (n, 3), m²."""
        lever = np.zeros((len(places), 3, 6))
        lever[:, :, :3] = motion_by_turn(places - self.centre) - self.taken_off
        lever[:, :, 3:] = np.eye(3)
        return np.asarray(lever @ self.covariance @ np.swapaxes(lever, 1, 2))


def motion_by_turn(arm: Float) -> Float:
    """(n, 3, 3) by which a rotation vector (rad) is multiplied for the motion (m) at places ``arm`` (n, 3) from it."""
    found = np.zeros((len(arm), 3, 3))
    found[:, 0, 1], found[:, 0, 2] = arm[:, 2], -arm[:, 1]
    found[:, 1, 0], found[:, 1, 2] = -arm[:, 2], arm[:, 0]
    found[:, 2, 0], found[:, 2, 1] = arm[:, 1], -arm[:, 0]
    return found
