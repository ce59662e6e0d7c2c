"""The motion of a zone from the points of all surveys at once, sharper than cells that grew for one pair show it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import ndimage, sparse
from scipy.sparse.linalg import splu

from ..core.arrays import Bool, Float, Index
from ..grid.block_moments import PLAIN_SUMS, UU, UV, UZ, VV, VZ, ZZ, Moments, N, U, V, Z, merged

_MAX_SIDE_CELLS = 40  # cells a side in which the motion is fitted: larger windows have larger cells
_FOLDS = 3
_SURFACE_STEPS_M2 = 10.0 ** np.arange(-4.0, 2.0)
_MOTION_STEPS = 10.0 ** np.arange(-3.0, 2.1, 0.5)
_REWEIGHTINGS = 6
_PINNED = 1e3  # points a node: the rim of the window does not move
_LEAST = 1e-9  # points a node, where nothing was measured

_Normal = tuple[sparse.csc_matrix, sparse.csc_matrix, sparse.csc_matrix, Float, Float]


@dataclass(frozen=True)
class JointMotion:
    """The motion of a zone, and what each survey says of it.

    Attributes:
        motion: (m + 1, n + 1) at the corners of cells, metres of a survey whose scale is 1. The first corner is that of
            the window; the last may lie beyond its end.
        multiple: side of these cells in those of the window, a power of two.
        variance: of a point about the surface, m².
    """

    motion: Float
    multiple: int
    variance: float
    _model: _Model
    _sums: Sequence[Float]
    _scales: Sequence[float]
    _steps: tuple[float, float]
    _weights: tuple[Float, Float]

    def of_surveys(self, inside: Bool) -> tuple[Float, Float]:
        """Mean motion of the cells ``inside`` (rows, columns) against the first survey, m, and its variance by the
        points alone, m²; (surveys,) each, 0 for the first.

        What a survey's motion differs from the joint one is fitted to its own points and those of the first survey,
        smooth like that. The variance is that of this fit, so that it grows where points are few, and that of an edge.
        """
        rows, columns = (between(length, self.multiple) for length in self.motion.shape)
        whole = np.zeros((len(rows), len(columns)))
        whole[: inside.shape[0], : inside.shape[1]] = inside / inside.sum()
        mean_of = (rows.T @ whole @ columns).ravel()
        edge = self._beyond_edge(rows @ self.motion @ columns.T, whole)
        joint, nothing = self.motion.ravel(), np.zeros(self.motion.size)
        means, variances = np.zeros((2, len(self._sums)))
        for number, (own, scale) in enumerate(zip(self._sums[1:], self._scales[1:], strict=True), 1):
            first, mixed, second, *right = self._model.normal([self._sums[0], own], [0.0, 1.0])
            right = [side - scale * matrix @ joint for side, matrix in zip(right, (mixed, second), strict=True)]
            factors = self._model.factors((first, mixed, second), *self._steps, self._weights)
            apart = factors.solve(np.concatenate(right))[joint.size :]
            means[number] = float(mean_of @ (scale * joint + apart))
            answer = factors.solve(np.concatenate([nothing, mean_of]))[joint.size :]
            variances[number] = self.variance * float(mean_of @ answer) + (scale * edge) ** 2
        return means, variances

    def _beyond_edge(self, motion: Float, mean_of: Float) -> float:
        """What the motion of cells overshoots at an edge, as a mean over the ground, m.

        Least squares make linear pieces overshoot within a step and undershoot beyond it (Gibbs phenomenon). The mean
        of the ground leaves out what lies beyond: motion of the other sign, up to the next corner.
        """
        inside = mean_of > 0
        around = np.ones((3, 3), dtype=bool)
        ring = ndimage.binary_dilation(inside, around, iterations=self.multiple) & ~inside
        sign = np.sign(float(np.sum(mean_of * motion)))
        return float(np.minimum(sign * motion[ring], 0.0).sum()) / np.count_nonzero(inside)


def joint_motion(sums: Sequence[Float], scales: Sequence[float], own: Bool, side: float) -> JointMotion:
    """The motion in a window around a zone.

    The surface of survey s is that of the first one plus ``scales[s]`` times the motion, each linear between corners.
    Both follow by least squares from the points of all surveys, where they lie, so that a change of the motion within a
    cell does no harm. The surface is smooth by its second differences. The motion is by its first ones, but may break:
    a difference far beyond those of the zone weighs little (weak membrane; Blake and Zisserman 1987, Visual
    Reconstruction; Cauchy's weights). How smooth they are is chosen by how well they predict cells that were left out.

    Args:
        sums: of each survey, (10, rows, columns) as in ``Moments``, heights from one level.
        own: (rows, columns) cells of the zone.
        side: of a cell, m.
    """
    multiple = 1
    while max(own.shape) > _MAX_SIDE_CELLS * multiple:
        multiple *= 2
    coarse = [_coarser(np.asarray(one[:PLAIN_SUMS]), side, multiple) for one in sums]
    model = _Model.of(coarse[0].shape[1:], side * multiple)
    near = np.zeros(model.shape, dtype=bool)
    row, column = np.nonzero(own)
    near[row // multiple, column // multiple] = True
    left_out = _folds(coarse)
    trained = [
        (model.normal([np.where(f == k, 0.0, s) for s, f in zip(coarse, left_out, strict=True)], scales), k)
        for k in range(_FOLDS)
    ]

    def error(surface: float, motion: float) -> float:
        squares = 0.0
        for normal, k in trained:
            ground, moved = model.solved(normal, surface, motion)
            for one, fold, scale in zip(coarse, left_out, scales, strict=True):
                squares += float(model.squares(np.where(fold == k, one, 0.0), ground + scale * moved).sum())
        return squares / max(sum(float(one[N].sum()) for one in coarse), 1.0)

    start = float(_MOTION_STEPS[4])
    surface, _ = _lowest(_SURFACE_STEPS_M2, 2, lambda step: error(step, start))
    motion, variance = _lowest(_MOTION_STEPS, 4, lambda step: error(surface, step))
    moved, weights = model.broken(model.normal(coarse, scales), surface, motion, near.ravel())
    return JointMotion(moved, multiple, variance, model, coarse, scales, (surface, motion), weights)


def between(corners: int, parts: int) -> Float:
    """Weights of the corners (parts, corners) at the middles of so many parts of each cell between them."""
    place = (np.arange((corners - 1) * parts) + 0.5) / parts
    before = place.astype(np.int64)
    weights = np.zeros((len(place), corners))
    weights[np.arange(len(place)), before] = 1.0 - (place - before)
    weights[np.arange(len(place)), before + 1] = place - before
    return weights


def _lowest(steps: Float, start: int, error: Callable[[float], float]) -> tuple[float, float]:
    """The step with the lowest error, downhill from ``start``, and that error."""
    known: dict[int, float] = {}

    def at(number: int) -> float:
        if number not in known:
            known[number] = error(float(steps[number])) if 0 <= number < len(steps) else np.inf
        return known[number]

    here = start
    while min(at(here - 1), at(here + 1)) < at(here):
        here += 1 if at(here + 1) < at(here - 1) else -1
    return float(steps[here]), at(here)


def _folds(sums: Sequence[Float]) -> list[Index]:
    """In which turn each cell of each survey is left out, (rows, columns)."""
    rng = np.random.default_rng(1)
    return [rng.integers(_FOLDS, size=one.shape[1:]) for one in sums]


def _coarser(sums: Float, side: float, multiple: int) -> Float:
    room = [(0, -length % multiple) for length in sums.shape[1:]]
    moments = Moments(np.pad(sums, [(0, 0), *room]), side)
    while multiple > 1:
        moments, multiple = merged(moments), multiple // 2
    return moments.sums


def _differences(count: int, order: int) -> sparse.csr_matrix:
    parts = {1: [-1.0, 1.0], 2: [1.0, -2.0, 1.0]}[order]
    return sparse.diags(parts, list(range(order + 1)), shape=(count - order, count), format="csr")


@dataclass(frozen=True)
class _Model:
    """Heights at the ``corners`` (4, rows, columns: north west, north east, south west, south east) of cells.

    ``plane`` (3, 4) gives height and gradient in the middle of a cell; ``rough`` the squares of the second differences,
    over the cell's area; ``steps`` the first differences along columns and rows, without the last of each.
    """

    corners: np.ndarray
    plane: Float
    rough: sparse.csc_matrix
    steps: tuple[sparse.csr_matrix, sparse.csr_matrix]
    rim: sparse.csc_matrix

    @classmethod
    def of(cls, shape: tuple[int, ...], side: float) -> _Model:
        rows, columns = shape[0] + 1, shape[1] + 1
        node = np.arange(rows * columns).reshape(rows, columns)
        corners = np.stack([node[:-1, :-1], node[:-1, 1:], node[1:, :-1], node[1:, 1:]])
        slope = 0.5 / side
        plane = np.array([[0.25] * 4, [-slope, slope, -slope, slope], [slope, slope, -slope, -slope]])
        down, along = sparse.identity(rows), sparse.identity(columns)
        second = [
            sparse.kron(_differences(rows, 2), along),
            sparse.kron(down, _differences(columns, 2)),
            np.sqrt(2.0) * sparse.kron(_differences(rows, 1), _differences(columns, 1)),
        ]
        rough = sum((part.T @ part for part in second[1:]), second[0].T @ second[0]) / side**2
        steps = (
            sparse.kron(_differences(rows, 1), along, format="csr"),
            sparse.kron(down, _differences(columns, 1), format="csr"),
        )
        rim = np.ones((rows, columns))
        rim[1:-1, 1:-1] = 0.0
        return cls(corners, plane, rough.tocsc(), steps, sparse.diags(_PINNED * rim.ravel(), format="csc"))

    @property
    def nodes(self) -> int:
        return int(self.rough.shape[0])

    @property
    def shape(self) -> tuple[int, int]:
        return self.corners.shape[1] + 1, self.corners.shape[2] + 1

    def normal(self, sums: Sequence[Float], scales: Sequence[float]) -> _Normal:
        """Normal equations of surface and motion: their matrices, the one between them, and the right sides."""
        n = self.nodes
        blocks = [sparse.csc_matrix((n, n))] * 3
        right = np.zeros((2, n))
        for s, scale in zip(sums, scales, strict=True):
            has = s[N] > 0
            s, corners = s[:, has], self.corners[:, has]
            by_plane = np.array([[s[N], s[U], s[V]], [s[U], s[UU], s[UV]], [s[V], s[UV], s[VV]]])
            values = np.einsum("ka,kln,lb->abn", self.plane, by_plane, self.plane)
            i, j = (np.broadcast_to(c, values.shape).ravel() for c in (corners[:, None], corners[None]))
            matrix = sparse.csc_matrix((values.ravel(), (i, j)), shape=(n, n))
            of_heights = np.einsum("ka,kn->an", self.plane, np.array([s[Z], s[UZ], s[VZ]]))
            height = np.bincount(corners.ravel(), of_heights.ravel(), n)
            blocks = [block + scale**power * matrix for power, block in enumerate(blocks)]
            right += np.array([[1.0], [scale]]) * height
        return blocks[0], blocks[1], blocks[2], right[0], right[1]

    def factors(
        self,
        matrices: tuple[sparse.csc_matrix, ...],
        surface: float,
        motion: float,
        weights: Sequence[Float] | None = None,
    ) -> Any:
        """Of the equations with what makes surface and motion smooth; ``weights`` of the motion's first differences."""
        first, mixed, second = matrices
        weights = weights or [np.ones(step.shape[0]) for step in self.steps]
        smooth = sum(
            (s.T @ sparse.diags(w) @ s for s, w in zip(self.steps, weights, strict=True)), start=0.0 * self.rough
        )
        first = first + surface * self.rough + _LEAST * sparse.identity(self.nodes)
        whole = sparse.bmat([[first, mixed], [mixed, second + motion * smooth + self.rim]], format="csc")
        # symmetric and positive: no pivots are needed
        return splu(whole, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})

    def solved(
        self, normal: _Normal, surface: float, motion: float, weights: Sequence[Float] | None = None
    ) -> tuple[Float, Float]:
        """Heights and motion (nodes,) each; arguments as for ``factors``."""
        found = self.factors(normal[:3], surface, motion, weights).solve(np.concatenate(normal[3:]))
        return found[: self.nodes], found[self.nodes :]

    def broken(self, normal: _Normal, surface: float, motion: float, near: Bool) -> tuple[Float, tuple[Float, Float]]:
        """The motion (m + 1, n + 1) that may break, and the weights of its differences; those at the nodes ``near``
        give the scale of all.
        """
        weights = np.ones(self.steps[0].shape[0]), np.ones(self.steps[1].shape[0])
        _, moved = self.solved(normal, surface, motion)
        scale = float(np.median(self._apart(moved)[near]))
        for _ in range(_REWEIGHTINGS if scale > 0 else 0):
            each = 2.0 / (1.0 + (self._apart(moved).reshape(self.shape) / scale) ** 2)
            weights = each[:-1].ravel(), each[:, :-1].ravel()
            _, moved = self.solved(normal, surface, motion, weights)
        return moved.reshape(self.shape), weights

    def _apart(self, moved: Float) -> Float:
        """By how much a node differs from the next ones, m (nodes,)."""
        field = moved.reshape(self.shape)
        down, along = (np.diff(field, axis=axis, append=np.take(field, [-1], axis)) for axis in (0, 1))
        return np.hypot(down, along).ravel()

    def squares(self, s: Float, heights: Float) -> Float:
        """Squares of the points' distances from the surface, m², summed up in each cell."""
        a, u, v = np.einsum("ka,aij->kij", self.plane, heights[self.corners])
        with_heights = a * s[Z] + u * s[UZ] + v * s[VZ]
        mixed = a * u * s[U] + a * v * s[V] + u * v * s[UV]
        return np.asarray(s[ZZ] - 2 * with_heights + a * a * s[N] + u * u * s[UU] + v * v * s[VV] + 2 * mixed)
