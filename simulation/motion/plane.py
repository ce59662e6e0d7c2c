"""The plane of a face, along which ground moves."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ...engine.core.arrays import Float


@dataclass(frozen=True)
class FacePlane:
    """A plane through (``u``, ``v``, ``z``) of the local frame that falls by ``dip`` degrees against v."""

    u: float
    v: float
    z: float
    dip: float

    @property
    def axes(self) -> Float:
        """(3, 3): rows are the directions across, up the dip and along the normal in (u, v, z)."""
        sine, cosine = self.sine, self.cosine
        return np.array([[1.0, 0.0, 0.0], [0.0, cosine, sine], [0.0, -sine, cosine]])

    @property
    def sine(self) -> float:
        return math.sin(math.radians(self.dip))

    @property
    def cosine(self) -> float:
        return math.cos(math.radians(self.dip))

    def across_and_along(self, u: Float, v: Float) -> tuple[Float, Float]:
        """Where the vertical over (u, v) meets the plane: metres across and up the dip from the origin."""
        return u - self.u, (v - self.v) / self.cosine
