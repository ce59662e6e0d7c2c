"""Heights of returns over the ground of a survey."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from ..core.arrays import Float
from ..geometry.numbered import united

NEIGHBOURS = 8
"""Nearest ground points to which the plane below a return is fitted."""
NODE_M = 0.5
_DAMPING = 0.05
_CORNERS = tuple(np.array(step) for step in ((0, 0), (0, 1), (1, 0), (1, 1)))


class Base:
    """The ground points (n, 3), m, of a survey as a surface.

    Planes are fitted to what is left over the plane through all, so that damping pulls a badly held one to that plane.
    """

    def __init__(self, ground: Float) -> None:
        self._middle = ground.mean(axis=0)
        local = ground - self._middle
        self._trend = np.linalg.lstsq(np.column_stack([local[:, :2], np.ones(len(local))]), local[:, 2], rcond=None)[0]
        self._xy = local[:, :2]
        self._rest = local[:, 2] - self._along(self._xy)
        self._tree = cKDTree(self._xy)

    def heights(self, xyz: Float) -> Float:
        """(n,) m of points (n, 3) over the ground, between nodes of ``NODE_M``."""
        place = (xyz[:, :2] - self._middle[:2]) / NODE_M
        low = np.floor(place).astype(np.int64)
        share = place - low
        origin = low.min(axis=0) if len(low) else np.zeros(2, dtype=np.int64)
        columns = int(low[:, 1].max() - origin[1]) + 2 if len(low) else 1
        corners = [(low - origin + step) @ np.array([columns, 1]) for step in _CORNERS]
        nodes = united(*corners)
        level = self._level((np.column_stack(np.divmod(nodes, columns)) + origin) * NODE_M)
        weights = [np.abs(1 - step - share).prod(axis=1) for step in _CORNERS]
        surface = sum(w * level[np.searchsorted(nodes, c)] for w, c in zip(weights, corners, strict=True))
        return np.asarray(xyz[:, 2] - self._middle[2] - surface)

    def _level(self, xy: Float) -> Float:
        """(m,) m of the ground over its middle at places (m, 2) from there."""
        _, near = self._tree.query(xy, k=min(NEIGHBOURS, len(self._xy)))
        near = near.reshape(len(xy), -1)
        offset, rest = self._xy[near] - xy[:, None], self._rest[near]
        centre, level = offset.mean(axis=1), rest.mean(axis=1)
        offset -= centre[:, None]
        rest -= level[:, None]
        square = np.einsum("mki,mkj->mij", offset, offset)
        damping = _DAMPING * np.trace(square, axis1=1, axis2=2)[:, None, None] + 1e-9
        slope = np.linalg.solve(square + damping * np.eye(2), np.einsum("mki,mk->mi", offset, rest)[..., None])[..., 0]
        return self._along(xy) + level - np.einsum("mi,mi->m", centre, slope)

    def _along(self, xy: Float) -> Float:
        return np.asarray(xy @ self._trend[:2] + self._trend[2])
