"""Vectors over the map, the registration's error added, and the motion that most of them share."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from scipy.special import chdtri

from ..core.arrays import Bool, Float, Index
from .facets import Facets
from .measure import Windows
from .registered import motion_by_turn
from .status import Status

_MAX_ROUNDS = 30
_TUKEY_ERRORS = 5.0  # standard errors from the common motion, beyond which a window does not count
_MEDIAN_CHI2 = 1.3863  # of two degrees of freedom


@dataclass(frozen=True)
class CommonMotion:
    """Motion (3,) in east, north, up that most windows share, metres, and its covariance (3, 3) without the
    registration's error.

    ``share`` is that of the windows that agree with it, ``windows`` how many there are, ``factor`` by how much their
    squared deviations exceed what is stated (1: as stated), ``centre`` (3,) the mean of their places, and ``by_turn``
    (3, 3) the motion that a turn about it feigns: windows that are known better in one direction count more in it.
    """

    motion: Float
    covariance: Float
    share: float
    windows: int
    factor: float
    centre: Float
    by_turn: Float


@dataclass(frozen=True)
class Vectors:
    """Motion of windows at places (n, 3), metres.

    Attributes:
        axes: (n, 3, 3) along the dip (downwards), across it and along the normal, row by row in the map's coordinates.
        motion: (n, 3) east, north, up, metres; NaN where ``status`` is not MEASURED.
        covariance: (n, 3, 3) of it, with the registration's error, m²; NaN where nothing is known.
        status: (n,) values of ``Status``.
        seen: (n,) share of the window that both surveys see.
        width: (n,) of the window, metres.
    """

    places: Float
    axes: Float
    motion: Float
    covariance: Float
    status: Index
    seen: Float
    width: Float

    @property
    def measured(self) -> Bool:
        return np.asarray(self.status == Status.MEASURED)

    @cached_property
    def in_plane(self) -> Float:
        """(n, 3) motion along the dip, across it and along the normal, metres."""
        return np.einsum("nij,nj->ni", self.axes, self.motion)

    @cached_property
    def in_plane_covariance(self) -> Float:
        """(n, 3, 3) of ``in_plane``, m²."""
        return np.asarray(self.axes @ self.covariance @ np.swapaxes(self.axes, 1, 2))

    @cached_property
    def statistic(self) -> Float:
        """(n,) squared length along the surface in standard errors: chi-squared with 2 degrees of freedom."""
        return squared_length(self.in_plane[:, :2], self.in_plane_covariance[:, :2, :2])

    @property
    def smallest(self) -> Float:
        """(n,) three standard errors along the surface in the direction known least, metres; NaN where unknown."""
        found = np.full(len(self.status), np.nan)
        known = np.isfinite(self.in_plane_covariance[:, 0, 0])
        found[known] = 3 * np.sqrt(np.linalg.eigvalsh(self.in_plane_covariance[known, :2, :2])[:, -1])
        return found

    def significant(self, confidence: float) -> Bool:
        """(n,) whether still ground shows such a motion with a probability of at most 1 - ``confidence``."""
        return np.asarray(np.nan_to_num(self.statistic) > threshold(confidence))

    def p_value(self, widths: int) -> Float:
        """(n,) probability that still ground shows such a motion in a window of any of so many ``widths``."""
        return np.minimum(widths * np.exp(-self.statistic / 2), 1.0)


def threshold(confidence: float) -> float:
    """Of ``Vectors.statistic``, which still ground stays below with that probability."""
    return float(chdtri(2, 1.0 - confidence))


def squared_length(vectors: Float, covariance: Float) -> Float:
    """(n,) d' C^-1 d of vectors (n, k) with covariances (n, k, k); NaN where one is not known."""
    found = np.full(len(vectors), np.nan)
    known = np.isfinite(vectors).all(axis=1) & np.isfinite(covariance).all(axis=(1, 2))
    away = np.linalg.solve(covariance[known], vectors[known][:, :, None])[:, :, 0]
    found[known] = (vectors[known] * away).sum(axis=1)
    return found


def in_the_map(windows: Windows, facets: Facets, places: Float, facet: Index) -> Vectors:
    """Windows of one size as vectors in the map's coordinates, without the registration's error."""
    axes = np.stack([frame.axes for frame in facets.frames])[facet]
    back = np.swapaxes(axes, 1, 2)
    return Vectors(
        places,
        axes,
        np.einsum("nij,nj->ni", back, windows.motion),
        back @ windows.covariance @ axes,
        windows.status,
        windows.seen,
        np.full(len(places), 2 * windows.radius),
    )


def with_error(vectors: Vectors, error: Float, taken_off: Float | None = None) -> Vectors:
    """Vectors with a covariance (n, 3, 3) or (3, 3) added to theirs, and without the motion ``taken_off`` (3,)."""
    motion = vectors.motion if taken_off is None else vectors.motion - taken_off
    return replace(vectors, motion=motion, covariance=vectors.covariance + error)


def confidence_of_each(confidence: float, widths: int) -> float:
    """With which each of so many widths is tested, so that still ground shows a motion in any as rarely as is meant."""
    return 1.0 - (1.0 - confidence) / widths


def likelihood_ratio(vectors: Vectors, motion: Float) -> Float:
    """(n,) logarithm of how much more likely windows move by ``motion`` (2,) or (n, 2), along the dip and across it in
    metres, than stand still; -infinity where either is not known.
    """
    own, covariance = vectors.in_plane[:, :2], vectors.in_plane_covariance[:, :2, :2]
    wanted = np.broadcast_to(motion, own.shape)
    found = np.full(len(own), -np.inf)
    known = vectors.measured & np.isfinite(wanted).all(axis=1)
    away = np.linalg.solve(covariance[known], wanted[known][..., None])[..., 0]
    found[known] = (away * (own - wanted / 2)[known]).sum(axis=1)
    return found


def chosen(take: Bool, one: Vectors, other: Vectors) -> Vectors:
    """``one`` at the places ``take`` (n,), the ``other`` elsewhere."""
    names = ("motion", "covariance", "status", "seen", "width")
    values: dict[str, Any] = {name: where(take, getattr(one, name), getattr(other, name)) for name in names}
    return replace(one, **values)


def where(take: Bool, one: Float, other: Float) -> Float:
    """(n, ...) ``one`` at the places ``take`` (n,), the ``other`` elsewhere."""
    return np.where(take.reshape(-1, *[1] * (one.ndim - 1)), one, other)


def common_motion(vectors: Vectors, independent: float, among: Bool | None = None) -> CommonMotion | None:
    """The motion that most of the measured windows ``among`` (n,) share; None where there are fewer than five.

    Robust weighted mean (Tukey's biweight of the deviations along the surface). Windows overlap, so that ``n`` of them
    count as ``n`` times the share ``independent``.
    """
    use = vectors.measured & np.isfinite(vectors.covariance[:, 0, 0])
    use = use if among is None else use & among
    if np.count_nonzero(use) < 5:
        return None
    motion, precision = vectors.motion[use], np.linalg.inv(vectors.covariance[use])
    plane, plane_covariance = vectors.in_plane[use][:, :2], vectors.in_plane_covariance[use][:, :2, :2]
    level = vectors.axes[use][:, :2]
    mean = np.median(motion, axis=0)
    for _ in range(_MAX_ROUNDS):
        off = plane - level @ mean
        distance = np.sqrt(squared_length(off, plane_covariance))
        weight = np.where(distance < _TUKEY_ERRORS, (1 - (distance / _TUKEY_ERRORS) ** 2) ** 2, 0.0)
        if not weight.any():
            return None
        total = (weight[:, None, None] * precision).sum(axis=0)
        before, mean = mean, np.linalg.solve(total, np.einsum("n,nij,nj->i", weight, precision, motion))
        if np.abs(mean - before).max() < 1e-6:
            break
    agreeing = distance**2 < threshold(0.99)
    factor = float(np.median(distance[agreeing] ** 2) / _MEDIAN_CHI2) if agreeing.any() else float("nan")
    centre = vectors.places[use].mean(axis=0)
    turned = motion_by_turn(vectors.places[use] - centre)
    by_turn = np.linalg.solve(total, np.einsum("n,nij,njk->ik", weight, precision, turned))
    covariance = np.linalg.inv(total) / min(independent, 1.0)
    return CommonMotion(mean, covariance, float(agreeing.mean()), len(motion), factor, centre, by_turn)
