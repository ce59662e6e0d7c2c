"""Motion of each window by itself and by its neighbours: how much they count follows from how far they differ.

The windows around a place scatter about their mean by their errors, and by what the motion differs from window to
window. The second part is estimated from the excess of the scatter over the errors (method of moments, DerSimonian and
Laird 1986, Controlled Clinical Trials 7). A window is then shrunk towards the mean by the share of its error in both
(empirical Bayes, Efron and Morris 1973, Journal of the American Statistical Association 68). Where all ground rests or
moves alike, errors become smaller. At the edge of a slide each window stands for itself.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np
from scipy.sparse import csr_matrix
from scipy.spatial import cKDTree
from scipy.special import log_ndtr

from ..core.arrays import Float, Index
from .frame import Frame
from .scan import common_share, matrices_of
from .vectors import Vectors, chosen

_ROWS = 20_000  # windows whose neighbours are in memory at a time


@dataclass(frozen=True)
class _Windows:
    """Windows of one facet: ``motion`` (n, 2) along its axes, metres, ``covariance`` (n, 2, 2), its inverse
    ``information``, ``flat`` (n, 2) places in the plane, and ``share`` (n, n) correlation of any two by their ground.
    """

    motion: Float
    covariance: Float
    information: Float
    flat: Float
    share: csr_matrix

    @classmethod
    def of(cls, vectors: Vectors, frame: Frame) -> _Windows:
        flat = frame.to_plane(vectors.places)[:, :2]
        covariance = vectors.in_plane_covariance[:, :2, :2]
        share = _shares(flat, vectors.width)
        inverse = np.asarray(np.linalg.inv(covariance), dtype=np.float64)
        return cls(vectors.in_plane[:, :2], covariance, inverse, flat, share)


def narrowest(sizes: Sequence[Vectors]) -> Vectors:
    """Of each place the narrowest measured window, from windows of each width, narrow ones first."""
    found = sizes[-1]
    for narrower in reversed(sizes[:-1]):
        found = chosen(narrower.measured, narrower, found)
    return found


def with_neighbours(sizes: Sequence[Vectors], facet: Index, frames: Sequence[Frame]) -> Vectors:
    """Of each place the narrowest measured window, its motion along the surface shrunk towards its neighbours.

    Neighbours are all windows of the facet that touch the widest one around the place. The motion along the normal,
    whose error is a tenth, stays as the window has it.

    Args:
        sizes: windows of each width, narrow ones first, without the registration's error.
        facet: (n,) facet of each window, of ``frames``.
    """
    found = narrowest(sizes)
    if len(sizes) == 1 or not len(found.places):
        return found
    reach = (float(sizes[0].width[0]) + float(sizes[-1].width[0])) / 2
    motion, covariance = found.motion.copy(), found.covariance.copy()
    for number, frame in enumerate(frames):
        mine = np.flatnonzero(found.measured & (facet == number))
        if len(mine):
            motion[mine], covariance[mine] = _shrunk(_taken(found, mine), frame, reach)
    return replace(found, motion=motion, covariance=covariance)


def _taken(vectors: Vectors, numbers: Index) -> Vectors:
    return Vectors(*(getattr(vectors, field.name)[numbers] for field in fields(vectors)))


def _shrunk(vectors: Vectors, frame: Frame, reach: float) -> tuple[Float, Float]:
    """Motions (n, 3) and covariances (n, 3, 3) in the map's coordinates."""
    windows = _Windows.of(vectors, frame)
    in_plane, covariance = vectors.in_plane.copy(), vectors.in_plane_covariance.copy()
    tree = cKDTree(windows.flat)
    for rows in np.array_split(np.arange(len(in_plane)), -(-len(in_plane) // _ROWS)):
        kernel = _kernel(tree, windows.flat[rows], reach)
        in_plane[rows, :2], own, covariance[rows, :2, :2] = _estimates(windows, rows, kernel)
        covariance[rows, :2, 2] = np.einsum("nij,nj->ni", own, covariance[rows, :2, 2])
        covariance[rows, 2, :2] = covariance[rows, :2, 2]
    axes = frame.axes
    return in_plane @ axes, axes.T @ covariance @ axes


def _kernel(tree: cKDTree, flat: Float, reach: float) -> csr_matrix:
    """(k, n) weight of each window for those at ``flat`` (k, 2): 1 at the place itself, 0 from ``reach`` on."""
    near = cKDTree(flat).sparse_distance_matrix(tree, reach, output_type="coo_matrix")
    return csr_matrix((1.0 - (near.data / reach) ** 2, (near.row, near.col)), shape=near.shape)


def _shares(flat: Float, width: Float) -> csr_matrix:
    """(n, n) correlation of windows: twice the area that both see by the sum of their areas."""
    near = cKDTree(flat).sparse_distance_matrix(cKDTree(flat), float(width.max()), output_type="coo_matrix")
    one, other = width[near.row], width[near.col]
    nested = 2 * np.minimum(one, other) ** 2 / (one**2 + other**2)
    share = common_share(2 * near.data / (one + other)) * nested
    return csr_matrix((share, (near.row, near.col)), shape=near.shape)


def _estimates(windows: _Windows, rows: Index, kernel: csr_matrix) -> tuple[Float, Float, Float]:
    """Motions (k, 2) of the windows ``rows`` (k,), the weight (k, 2, 2) of their own one, and covariances (k, 2, 2)."""
    information = windows.information[:, (0, 0, 1), (0, 1, 1)]
    own = windows.covariance[rows]
    score = np.einsum("nij,nj->ni", windows.information, windows.motion)
    back = np.asarray(np.linalg.inv(matrices_of(kernel @ information)), dtype=np.float64)
    mean = np.einsum("nij,nj->ni", back, kernel @ score)
    spread = matrices_of(kernel.multiply(kernel @ windows.share) @ information)
    differing = _differing(windows, kernel, mean, back, spread)[:, None, None] * np.eye(2)
    weight = differing @ np.linalg.inv(differing + own)
    rest = np.eye(2) - weight
    motion = mean + np.einsum("nij,nj->ni", weight, windows.motion[rows] - mean)
    common = back @ matrices_of(kernel.multiply(windows.share[rows]) @ information) @ own
    both = rest @ common @ np.swapaxes(weight, 1, 2)
    of_mean = rest @ (back @ spread @ back + differing) @ np.swapaxes(rest, 1, 2)
    covariance = of_mean + weight @ own @ np.swapaxes(weight, 1, 2) + both + np.swapaxes(both, 1, 2)
    return motion, weight, covariance


def _differing(windows: _Windows, kernel: csr_matrix, mean: Float, back: Float, spread: Float) -> Float:
    """(k,) variance of the motion between windows, m²: its mean by what their scatter says, which is never negative."""
    pairs = kernel.tocoo()
    off = windows.motion[pairs.col] - mean[pairs.row]
    distance = np.einsum("ni,nij,nj->n", off, windows.information[pairs.col], off)
    count = kernel.shape[0]
    scatter = np.bincount(pairs.row, pairs.data * distance, count)
    total = np.asarray(kernel.sum(axis=1)).ravel()
    expected = 2 * total - np.einsum("nij,nji->n", back, spread)
    variance = 4 * np.asarray(kernel.multiply(kernel @ windows.share.power(2)).sum(axis=1)).ravel()
    squared = (windows.information @ windows.information)[:, (0, 0, 1), (0, 1, 1)]
    trace = windows.information[:, 0, 0] + windows.information[:, 1, 1]
    slope = kernel @ trace - np.einsum("nij,nji->n", back, matrices_of(kernel.power(2) @ squared))
    alone = slope <= 1e-9 * (kernel @ trace)
    slope[alone] = np.inf
    found = (scatter - expected) / slope
    error = np.sqrt(variance) / slope * np.maximum(scatter / np.maximum(expected, 1e-9), 1.0)
    return np.where(alone, 0.0, _mean_if_positive(found, np.where(alone, 1.0, error)))


def _mean_if_positive(value: Float, error: Float) -> Float:
    """Mean of a normal distribution about ``value`` of which only the positive part is possible."""
    ratio = value / error
    return np.asarray(value + error * np.exp(-(ratio**2) / 2 - log_ndtr(ratio)) / np.sqrt(2 * np.pi))
