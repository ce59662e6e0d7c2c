"""The registration's error as motion that it feigns."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..core.arrays import Float


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

    def at(self, places: Float) -> Float:
        """(n, 3, 3) covariance of the motion that the error feigns at places (n, 3), m²."""
        arm = places - self.centre
        lever = np.zeros((len(places), 3, 6))
        lever[:, 0, 1], lever[:, 0, 2] = arm[:, 2], -arm[:, 1]
        lever[:, 1, 0], lever[:, 1, 2] = -arm[:, 2], arm[:, 0]
        lever[:, 2, 0], lever[:, 2, 1] = arm[:, 1], -arm[:, 0]
        lever[:, :, 3:] = np.eye(3)
        return np.asarray(lever @ self.covariance @ np.swapaxes(lever, 1, 2))
