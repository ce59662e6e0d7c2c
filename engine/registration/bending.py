"""What one rigid motion leaves on stable ground, fitted by a correction of heights that bends over tens of metres.

Strips that were adjusted badly and surveys that are bent like a bowl differ from place to place by more than noise.
The correction has one height for each node of a wide lattice, is fitted by least squares to stable ground alone, and
is held back by a prior that its nodes are alike (a Gaussian random field; Rue and Held 2005, chapter 3), so that it
stays level where nothing is known. Whether it is applied is decided on held-out blocks.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..core.arrays import Float, Index
from ..geometry.height_correction import HeightCorrection, Nodes
from ..geometry.pose import Pose
from ..geometry.voxels import block_numbers
from ..statistics.robust import nmad, robust_scale
from .point_to_plane import Matcher, regional_weights, tukey_weights

_SOURCES = 40_000
_MIN_UPWARD_NORMAL = 0.2  # least vertical part of a normal: heights of steeper faces are imprecise
_BLOCKS_PER_NODE = 5.0  # blocks between two nodes
_MIN_BLOCK_PAIRS, _MIN_BLOCKS = 10, 12
_EXPECTED_BEND_M = 0.03  # metres from node to node that are to be expected at most (one standard deviation)
_EXPECTED_LEVEL_M = 0.10  # metres, of the whole
_MAX_ROUNDS = 8
_FOLDS = 5
_MAX_REMAINING_MISFIT_SHARE = 0.7  # share of the misfit that may remain
_MIN_MISFIT_M = 0.003  # metres


@dataclass(frozen=True)
class Bend:
    """How far stable ground is bent after a rigid motion, in heights, metres.

    Attributes:
        correction: the smooth correction.
        before: spread of the stable blocks' mean height differences.
        after: the same less a correction that was fitted without them.
        noise: what the noise of the blocks' means explains of both.
    """

    correction: HeightCorrection
    before: float
    after: float
    noise: float

    @property
    def worth(self) -> bool:
        """Whether the correction clearly reduces the error on held-out ground."""
        before, after = (np.sqrt(max(v**2 - self.noise**2, 0.0)) for v in (self.before, self.after))
        return bool(before > max(_MIN_MISFIT_M, self.noise) and after < _MAX_REMAINING_MISFIT_SHARE * before)


@dataclass(frozen=True)
class _Blocks:
    """Means over the stable pairs of each block: place (n, 2), height difference, and its variance."""

    place: Float
    height: Float
    variance: Float


def measure_bend(matcher: Matcher, pose: Pose, spacing: float, reach: float, scale: float) -> Bend | None:
    """Fit the correction at ``pose``, in local coordinates; None where the ground is too small or too little stable.

    Args:
        spacing: from node to node, metres.
        reach: how far apart the surfaces may still be, metres.
        scale: noise of the residuals, metres.
    """
    pairs = matcher.match(pose, matcher.sample(_SOURCES), reach)
    pairs = pairs.chosen(np.abs(pairs.normal[:, 2]) > _MIN_UPWARD_NORMAL)
    if len(pairs) < _MIN_BLOCKS * _MIN_BLOCK_PAIRS:
        return None
    plan = pairs.place[:, :2]
    if np.ptp(plan, axis=0).max() < 2 * spacing:
        return None
    nodes = Nodes.over(plan, spacing)
    weights = nodes.weights(plan)
    upward = np.abs(pairs.normal[:, 2])
    height = pairs.residual / pairs.normal[:, 2]
    number = block_numbers(np.column_stack([plan, np.zeros(len(plan))]), spacing / _BLOCKS_PER_NODE)
    region = max(10 * matcher.spacing, 5 * scale)
    correction = np.zeros(nodes.rows * nodes.columns)
    blocks, extra = None, 0.0
    for _ in range(_MAX_ROUNDS):
        left = (height + weights @ correction) * upward
        # never wider than at the rigid motion: what it took for change stays change
        scale = min(max(robust_scale(left), 1e-4), scale)
        now = replace(pairs, residual=left)
        weight = tukey_weights(left, scale) * regional_weights(now, scale, region)
        blocks = _blocks(plan, height, weight * upward**2, left / upward, number)
        if len(blocks.height) < _MIN_BLOCKS:
            return None
        previous, (correction, covariance) = correction, _fit(nodes, blocks, extra)
        # relief that both surveys sampled unevenly adds to the noise of the means
        rest = blocks.height + nodes.weights(blocks.place) @ correction
        extra = max(nmad(rest, 0.0) ** 2 - float(np.median(blocks.variance)), 0.0)
        if np.abs(correction - previous).max() < 1e-4:
            break
    assert blocks is not None
    before, after = blocks.height, blocks.height + _predicted(nodes, blocks, extra)
    shape = (nodes.rows, nodes.columns)
    sd = np.sqrt(np.diag(covariance))
    return Bend(
        HeightCorrection(nodes, correction.reshape(shape), sd.reshape(shape)),
        nmad(before, 0.0),
        nmad(after, 0.0),
        float(np.sqrt(np.median(blocks.variance))),
    )


def _blocks(plan: Float, height: Float, weight: Float, left: Float, number: Index) -> _Blocks:
    """Args: left: (n,) height difference less the correction so far, for the blocks' variances."""
    total = np.bincount(number, weight)
    stable = np.bincount(number, weight > 0)
    enough = (stable >= _MIN_BLOCK_PAIRS) & (stable >= 0.5 * np.bincount(number))
    safe = np.where(enough, total, 1.0)

    def mean(values: Float) -> Float:
        return np.asarray(np.bincount(number, weight * values) / safe)

    # sum of w² over (sum of w)²: the variance of a weighted mean of alike values
    scatter = np.bincount(number, weight**2) / safe**2
    inside = weight > 0
    variance = float(np.average(left[inside] ** 2, weights=weight[inside])) * scatter
    place = np.column_stack([mean(plan[:, 0]), mean(plan[:, 1])])
    return _Blocks(place[enough], mean(height)[enough], variance[enough])


def _fit(nodes: Nodes, blocks: _Blocks, extra: float) -> tuple[Float, Float]:
    """Heights of the nodes that take the blocks' differences away, and their covariance.

    Args:
        extra: variance of a block's mean in addition to that of its noise, square metres.
    """
    design = nodes.weights(blocks.place).toarray()
    weight = 1.0 / (blocks.variance + extra)
    normal = design.T @ (design * weight[:, None])
    bend = nodes.differences()
    precision = normal + bend.T @ bend / _EXPECTED_BEND_M**2 + np.eye(design.shape[1]) / _EXPECTED_LEVEL_M**2
    covariance = np.linalg.inv(precision)
    return np.asarray(-covariance @ (design.T @ (weight * blocks.height))), covariance


def _predicted(nodes: Nodes, blocks: _Blocks, extra: float) -> Float:
    """The correction (n,) at each block by a fit to the other folds of blocks, which are taken in stripes."""
    cell = np.floor((blocks.place - blocks.place.min(axis=0)) / (nodes.spacing / _BLOCKS_PER_NODE) + 1e-6).astype(int)
    fold = (cell[:, 0] + 2 * cell[:, 1]) % _FOLDS
    found = np.zeros(len(fold))
    for k in range(_FOLDS):
        out = fold == k
        if out.any() and not out.all():
            seen = _Blocks(blocks.place[~out], blocks.height[~out], blocks.variance[~out])
            found[out] = nodes.weights(blocks.place[out]) @ _fit(nodes, seen, extra)[0]
    return found
