"""The axes of a plane along which a slope is measured."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..core.arrays import Float


@dataclass(frozen=True)
class Frame:
    """A plane's axes: along the dip downwards, across it to the left when one looks down, and normal to it.

    ``axes`` (3, 3) holds them row by row in the map's coordinates, ``origin`` (3,) is a point near the plane, metres.
    On level ground the first axis is east.
    """

    axes: Float
    origin: Float

    def to_plane(self, xyz: Float) -> Float:
        """(n, 3) along the dip, across and above the plane, metres."""
        return np.asarray((xyz - self.origin) @ self.axes.T)

    def to_map(self, vectors: Float) -> Float:
        """(n, 3) vectors of this frame as east, north and up."""
        return np.asarray(vectors @ self.axes)

    def rotated(self, covariance: Float) -> Float:
        """(n, 3, 3) covariances in this frame as those of east, north and up."""
        return np.asarray(self.axes.T @ covariance @ self.axes)
