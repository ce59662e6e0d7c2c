"""What motion is measured against: the registration, or ground whose motion is taken off."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..core.arrays import Float
from .registered import Registered
from .vectors import CommonMotion


@dataclass(frozen=True)
class Reference:
    """What rests by definition, and the error of that.

    Attributes:
        registered: error of the registration that is left: its turn alone about the middle of ground that rests.
        taken_off: (3,) east, north, up of the ground that rests, metres; zero where none is.
        covariance: (3, 3) of ``taken_off``, m².
    """

    registered: Registered
    taken_off: Float
    covariance: Float

    @classmethod
    def of(cls, registered: Registered, ground: CommonMotion | None = None) -> Reference:
        """The registration with its error, or ``ground`` that rests in its place.

        The motion of that ground holds the registration's shift there, with its error; away from its middle the turn
        of the registration feigns motion still.
        """
        if ground is None:
            return cls(registered, np.zeros(3), np.zeros((3, 3)))
        return cls(registered.turned_about(ground.centre, ground.by_turn), ground.motion, ground.covariance)

    def at(self, places: Float) -> Float:
        """(n, 3, 3) covariance of the motion that nothing but error feigns at places (n, 3), m²."""
        return np.asarray(self.registered.at(places) + self.covariance)
