"""Point-to-plane distances between two surfaces in both directions, robustly weighted.

Chen and Medioni 1992 (doi:10.1016/0262-8856(92)90066-C) with Tukey's biweight. The points of each cloud are compared
with the planes of the other one: a plane through a curved neighbourhood lies on its hollow side, which moves the
clouds apart in one direction and together in the other and cancels in the sum. The distance is taken along the mean of
both surfaces' normals (Rusinkiewicz 2019, doi:10.1145/3306346.3323037), of which the noise is smaller than of one.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .pose import Pose
from .surface import Surface
from .voxel import block_numbers

Float = NDArray[np.float64]
Index = NDArray[np.int64]
Mask = NDArray[np.bool_]

TUKEY = 4.685  # 95 % efficiency on normal noise
_QUANTILE, _NORMAL = 0.3, 0.38532  # the 30 % quantile of |r| is 0.385 standard deviations: it stands 60 % of change


@dataclass(frozen=True)
class Pairs:
    """Places (n, 3) and unit normals (n, 3) in the reference frame; signed distance ``residual`` (n,), moving minus
    reference along the normal; ``source`` (n,): number of the source point.
    """

    place: Float
    normal: Float
    residual: Float
    source: Index

    def __len__(self) -> int:
        return len(self.residual)

    def chosen(self, which: Mask) -> Pairs:
        return Pairs(self.place[which], self.normal[which], self.residual[which], self.source[which])

    def jacobian(self, radius: float) -> Float:
        """(n, 6) derivative of the residual by the vector of ``Pose.moved``."""
        return np.hstack([np.cross(self.place, self.normal) / radius, self.normal])


@dataclass(frozen=True)
class Matcher:
    """Two surfaces to be compared. ``stable`` (points of the reference,) restricts the comparison to known ground."""

    reference: Surface
    moving: Surface
    stable: Mask | None = None

    def sample(self, limit: int) -> tuple[Index, Index]:
        """At most ``limit`` sources of each surface."""
        return self.reference.sample(limit, self.stable), self.moving.sample(limit)

    def onto_reference(self, pose: Pose, sources: Index, reach: float, agreement: float) -> Pairs:
        """The moving surface's points against the planes of the reference.

        Args:
            reach: largest distance of a point from the plane's own point, metres.
            agreement: least cosine between the two surfaces' normals.
        """
        place = pose.apply(self.moving.points[sources])
        distance, number = self.reference.nearest(place, reach)
        found = np.isfinite(distance)
        if self.stable is not None:
            found[found] = self.stable[number[found]]
        sources, number, place = sources[found], number[found], place[found]
        self.reference.fit(number)
        self.moving.fit(sources)
        normal, keep = _mean_normals(
            self.reference.normals[number], self.moving.normals[sources] @ pose.rotation.T, agreement
        )
        keep &= self.reference.planar[number] & self.moving.planar[sources]
        place, normal, number = place[keep], normal[keep], number[keep]
        residual = np.einsum("ij,ij->i", place - self.reference.centroids[number], normal)
        return Pairs(place, normal, residual, sources[keep])

    def onto_moving(self, pose: Pose, sources: Index, reach: float, agreement: float) -> Pairs:
        """The reference's points against the planes of the moving surface."""
        place = self.reference.points[sources]
        distance, number = self.moving.nearest(pose.undo(place), reach)
        found = np.isfinite(distance)
        sources, number, place = sources[found], number[found], place[found]
        self.reference.fit(sources)
        self.moving.fit(number)
        normal, keep = _mean_normals(
            self.moving.normals[number] @ pose.rotation.T, self.reference.normals[sources], agreement
        )
        keep &= self.moving.planar[number] & self.reference.planar[sources]
        place, normal, number = place[keep], normal[keep], number[keep]
        plane = pose.apply(self.moving.centroids[number])
        return Pairs(place, normal, np.einsum("ij,ij->i", plane - place, normal), sources[keep])

    def match(self, pose: Pose, sources: tuple[Index, Index], reach: float, agreement: float = 0.8) -> Pairs:
        """Both directions together."""
        one = self.onto_moving(pose, sources[0], reach, agreement)
        two = self.onto_reference(pose, sources[1], reach, agreement)
        return Pairs(
            np.vstack([one.place, two.place]),
            np.vstack([one.normal, two.normal]),
            np.concatenate([one.residual, two.residual]),
            np.concatenate([one.source, two.source]),
        )


def _mean_normals(own: Float, other: Float, agreement: float) -> tuple[Float, Mask]:
    """Unit vectors amid two unit vectors (n, 3) each, on the side of the first, and where these agree."""
    cosine = np.einsum("ij,ij->i", own, other)
    both = own + np.where(cosine < 0, -1.0, 1.0)[:, None] * other
    return both / np.linalg.norm(both, axis=1, keepdims=True), np.abs(cosine) > agreement


def robust_scale(residual: Float) -> float:
    """Standard deviation of the residuals' core, whatever the other 60 % are; 0 for none.

    A quantile near zero belongs to the unchanged ground as long as that is the largest part near zero; what lies
    outside three of it is then left out and the quantile taken again.
    """
    size = np.sort(np.abs(residual))
    scale = np.inf
    for _ in range(5):
        size = size[: np.searchsorted(size, 3 * scale, side="right")]
        if not len(size):
            return 0.0
        scale = float(size[int(_QUANTILE * (len(size) - 1))]) / _NORMAL
    return scale


def tukey_weights(residual: Float, scale: float) -> Float:
    """Tukey's biweight: 1 at zero, 0 from ``TUKEY`` scales on."""
    weight: Float = np.maximum(1.0 - (residual / (TUKEY * scale)) ** 2, 0.0) ** 2
    return weight


def regional_weights(pairs: Pairs, scale: float, block: float) -> Float:
    """Weight 1 in blocks whose pairs agree as well as usual, falling to 0 where half as many do.

    Lowered ground keeps pairs that seem to agree, such as those on walls, along which a lowering slides. Their
    neighbours tell that the place has changed.
    """
    number = block_numbers(pairs.place, block)
    inside = np.abs(pairs.residual) < 3 * scale
    share = (np.bincount(number, inside) / np.bincount(number))[number]
    weight: Float = np.clip((share / max(float(np.median(share)), 1e-9) - 0.5) / 0.3, 0.0, 1.0)
    return weight
