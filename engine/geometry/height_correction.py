"""A smooth correction of heights over the plan, kept as heights of nodes with bilinear interpolation between them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.sparse import csr_array

from ..core.arrays import Float


@dataclass(frozen=True)
class Nodes:
    """A lattice over the plan: the first node at ``west``, ``south`` (metres), ``spacing`` (m) from node to node."""

    west: float
    south: float
    spacing: float
    rows: int
    columns: int

    @classmethod
    def over(cls, xy: Float, spacing: float) -> Nodes:
        """Nodes around the middle of the places (n, 2), enough to hold all."""
        low, high = xy.min(axis=0), xy.max(axis=0)
        columns, rows = (int(n) + 1 for n in np.maximum(np.ceil((high - low) / spacing), 1))
        west, south = (low + high) / 2 - spacing * np.array([columns - 1, rows - 1]) / 2
        return cls(float(west), float(south), spacing, rows, columns)

    def weights(self, xy: Float) -> csr_array:
        """(n, rows * columns) bilinear weights of the nodes at places (n, 2); outside, those of the nearest edge."""
        count = len(xy)
        u = np.clip((xy[:, 0] - self.west) / self.spacing, 0, self.columns - 1)
        v = np.clip((xy[:, 1] - self.south) / self.spacing, 0, self.rows - 1)
        i = np.minimum(u.astype(np.int64), self.columns - 2)
        j = np.minimum(v.astype(np.int64), self.rows - 2)
        u, v = u - i, v - j
        first = j * self.columns + i
        number = np.stack([first, first + 1, first + self.columns, first + self.columns + 1], axis=1)
        weight = np.stack([(1 - u) * (1 - v), u * (1 - v), (1 - u) * v, u * v], axis=1)
        place = np.repeat(np.arange(count), 4)
        return csr_array((weight.ravel(), (place, number.ravel())), shape=(count, self.rows * self.columns))

    def differences(self) -> Float:
        """(k, rows * columns): one node less its neighbour, for all neighbours to the east and to the north."""
        number = np.arange(self.rows * self.columns).reshape(self.rows, self.columns)
        pairs = np.vstack(
            [
                np.column_stack([number[:, :-1].ravel(), number[:, 1:].ravel()]),
                np.column_stack([number[:-1].ravel(), number[1:].ravel()]),
            ]
        )
        matrix = np.zeros((len(pairs), number.size))
        matrix[np.arange(len(pairs)), pairs[:, 0]] = -1.0
        matrix[np.arange(len(pairs)), pairs[:, 1]] = 1.0
        return matrix

    def moved(self, shift: Float) -> Nodes:
        """The same lattice ``shift`` (2,) metres farther east and north."""
        return Nodes(self.west + float(shift[0]), self.south + float(shift[1]), self.spacing, self.rows, self.columns)


@dataclass(frozen=True)
class HeightCorrection:
    """Metres to be added to heights after a rigid motion: ``heights`` (rows, columns) of ``nodes``, from the south
    up, and their standard errors ``sd``.
    """

    nodes: Nodes
    heights: Float
    sd: Float

    def at(self, xy: Float) -> Float:
        """The correction (n,) at places (n, 2), metres."""
        return np.asarray(self.nodes.weights(xy) @ self.heights.ravel())

    def apply(self, xyz: Float) -> Float:
        """Corrected copy of points (n, 3)."""
        corrected = xyz.copy()
        corrected[:, 2] += self.at(xyz[:, :2])
        return corrected

    def undo(self, xyz: Float) -> Float:
        """The inverse of ``apply``, exactly, as only heights change."""
        original = xyz.copy()
        original[:, 2] -= self.at(xyz[:, :2])
        return original

    def facts(self) -> dict[str, Any]:
        """As JSON takes it; all lengths in metres."""
        return {
            "west": self.nodes.west,
            "south": self.nodes.south,
            "spacing": self.nodes.spacing,
            "heights": self.heights.tolist(),
            "standard_errors": self.sd.tolist(),
        }

    @classmethod
    def from_facts(cls, facts: Mapping[str, Any]) -> HeightCorrection:
        """The inverse of ``facts``.

        Raises:
            ValueError: something makes no sense.
        """
        if len({len(row) for row in (*facts["heights"], *facts["standard_errors"])}) > 1:
            raise ValueError("its pieces are not two tables of the same size")
        heights, sd = (np.array(facts[name], dtype=np.float64) for name in ("heights", "standard_errors"))
        if heights.ndim != 2 or min(heights.shape) < 2 or sd.shape != heights.shape:
            raise ValueError("its pieces are not two tables of the same size")
        spacing, west, south = (float(facts[name]) for name in ("spacing", "west", "south"))
        if not np.isfinite([*heights.ravel(), *sd.ravel(), spacing, west, south]).all() or spacing <= 0:
            raise ValueError("its pieces hold numbers that are not finite, or no spacing")
        return cls(Nodes(west, south, spacing, *heights.shape), heights, sd)
