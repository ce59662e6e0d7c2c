"""Rigid motion of the second epoch's coordinates."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from pyproj import CRS

from ..engine.outputs import atomic_output

Float = NDArray[np.float64]


@dataclass(frozen=True)
class RigidTransform:
    """x' = R (x - centre) + centre + t."""

    rotation: Float
    translation: Float
    centre: Float

    def apply(self, xyz: Float) -> Float:
        moved: Float = (xyz - self.centre) @ self.rotation.T + self.centre + self.translation
        return moved

    def inverse(self) -> RigidTransform:
        return RigidTransform(self.rotation.T, -self.translation @ self.rotation, self.centre + 0.0)

    @property
    def matrix(self) -> Float:
        matrix = np.eye(4)
        matrix[:3, :3] = self.rotation
        matrix[:3, 3] = self.centre + self.translation - self.rotation @ self.centre
        return matrix

    def save(self, path: Path, crs: CRS) -> None:
        with atomic_output(path) as partial:
            partial.write_text(json.dumps({"matrix": self.matrix.tolist(), "crs": crs.to_string()}, indent=2))
