"""Point-to-plane distances between two surfaces in both directions, robustly weighted.

Chen and Medioni 1992 (doi:10.1016/0262-8856(92)90066-C) with Tukey's biweight. The points of each cloud are compared
with the planes of the other one: a plane through a curved neighbourhood lies on its hollow side, which moves the
clouds apart in one direction and together in the other and cancels in the sum. The distance is taken along the mean of
both surfaces' normals (Rusinkiewicz 2019, doi:10.1145/3306346.3323037), of which the noise is smaller than of one.
A point's own distance shows whether it belongs to what has changed. How far the surfaces lie apart there is measured at
the place halfway between it and the centre of its own plane: half of its noise is gone, because all points around it
contribute, and of the relief that stops a slide along the surface less is lost than by the centre alone.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..core.arrays import Bool, Float, Index
from ..geometry.pose import Pose, turned
from ..geometry.voxels import block_numbers
from .surface import Surface
from .tracked_neighbours import TrackedNeighbours

TUKEY = 4.685  # 95 % efficiency on normal noise
# the 30 % quantile of |r| is 0.385 standard deviations: it stands 60 % of change
_QUANTILE, _NORMAL_QUANTILE = 0.3, 0.38532


@dataclass(frozen=True)
class Pairs:
    """Where the surfaces were compared, in the reference frame.

    Attributes:
        place, normal: (n, 3), normals of unit length.
        residual: (n,) signed distance of point and plane, moving minus reference along the normal, metres.
        gap: (n,) the same of the place halfway between the point and the centre of its own plane.
        source: (n,) number of the source point.
    """

    place: Float
    normal: Float
    residual: Float
    gap: Float
    source: Index

    def __len__(self) -> int:
        return len(self.residual)

    def chosen(self, which: Bool) -> Pairs:
        return Pairs(*(values[which] for values in vars(self).values()))

    def jacobian(self, radius: float) -> Float:
        """(n, 6) derivative of the residual by the vector of ``Pose.moved``."""
        x, y, z = self.place.T / radius
        u, v, w = self.normal.T
        # in columns, along which it is summed
        return np.stack([y * w - z * v, z * u - x * w, x * v - y * u, u, v, w]).T


@dataclass(frozen=True)
class Matcher:
    """Two surfaces to be compared.

    ``stable`` (points of the reference,) and ``firm`` (points of the moving surface,) restrict the comparison to them.
    """

    reference: Surface
    moving: Surface
    stable: Bool | None = None
    firm: Bool | None = None

    def sample(self, limit: int) -> tuple[Index, Index]:
        """At most ``limit`` sources of each surface."""
        return self.reference.sample(limit, self.stable), self.moving.sample(limit, self.firm)

    @cached_property
    def _of_moving(self) -> TrackedNeighbours:
        return TrackedNeighbours(self.reference.tree, len(self.moving.points))

    @cached_property
    def _of_reference(self) -> TrackedNeighbours:
        return TrackedNeighbours(self.moving.tree, len(self.reference.points))

    def distance(self, pose: Pose, sources: Index, reach: float) -> Float:
        """(n,) from the moving surface's points to the nearest one of the reference; infinity beyond ``reach``."""
        return self.neighbours(pose, sources, reach)[0]

    def neighbours(self, pose: Pose, sources: Index, reach: float) -> tuple[Float, Index]:
        """As ``distance``, and the (n,) numbers of those points."""
        return self._of_moving.nearest(sources, pose.apply(self.moving.points[sources]), reach)

    def neighbours_back(self, pose: Pose, sources: Index, reach: float) -> tuple[Float, Index]:
        """From the reference's points to the nearest one of the moving surface, as ``neighbours``."""
        return self._of_reference.nearest(sources, pose.undo(self.reference.points[sources]), reach)

    def onto_reference(self, pose: Pose, sources: Index, reach: float, agreement: float) -> Pairs:
        """The moving surface's points against the planes of the reference.

        Args:
            reach: largest distance of a point from the plane's own point, metres.
            agreement: least cosine between the two surfaces' normals.
        """
        place = pose.apply(self.moving.points[sources])
        distance, number = self._of_moving.nearest(sources, place, reach)
        found = np.isfinite(distance)
        if self.stable is not None:
            found[found] = self.stable[number[found]]
        found = np.flatnonzero(found)
        sources, number = sources[found], number[found]
        self.reference.fit(number)
        self.moving.fit(sources)
        normal, keep = _mean_normals(
            np.take(self.reference.normals, number, axis=0),
            turned(np.take(self.moving.normals, sources, axis=0), pose.rotation),
            agreement,
        )
        keep &= self.reference.planar[number] & self.moving.planar[sources]
        kept = np.flatnonzero(keep)
        place, normal = np.take(place, found[kept], axis=0), np.take(normal, kept, axis=0)
        plane = np.take(self.reference.centroids, number[kept], axis=0)
        around = (place + pose.apply(np.take(self.moving.centroids, sources[kept], axis=0))) / 2
        return Pairs(place, normal, _along(place - plane, normal), _along(around - plane, normal), sources[kept])

    def onto_moving(self, pose: Pose, sources: Index, reach: float, agreement: float) -> Pairs:
        """The reference's points against the planes of the moving surface."""
        place = np.take(self.reference.points, sources, axis=0)
        distance, number = self._of_reference.nearest(sources, pose.undo(place), reach)
        near = np.isfinite(distance)
        if self.firm is not None:
            near[near] = self.firm[number[near]]
        found = np.flatnonzero(near)
        sources, number = sources[found], number[found]
        self.reference.fit(sources)
        self.moving.fit(number)
        normal, keep = _mean_normals(
            turned(np.take(self.moving.normals, number, axis=0), pose.rotation),
            np.take(self.reference.normals, sources, axis=0),
            agreement,
        )
        keep &= self.moving.planar[number] & self.reference.planar[sources]
        kept = np.flatnonzero(keep)
        place, normal = np.take(place, found[kept], axis=0), np.take(normal, kept, axis=0)
        plane = pose.apply(np.take(self.moving.centroids, number[kept], axis=0))
        around = (place + np.take(self.reference.centroids, sources[kept], axis=0)) / 2
        return Pairs(place, normal, _along(plane - place, normal), _along(plane - around, normal), sources[kept])

    def match(self, pose: Pose, sources: tuple[Index, Index], reach: float, agreement: float = 0.8) -> Pairs:
        """Both directions together."""
        one = self.onto_moving(pose, sources[0], reach, agreement)
        two = self.onto_reference(pose, sources[1], reach, agreement)
        return Pairs(*(np.concatenate(both) for both in zip(vars(one).values(), vars(two).values(), strict=True)))


def _mean_normals(own: Float, other: Float, agreement: float) -> tuple[Float, Bool]:
    """Unit vectors amid two unit vectors (n, 3) each, on the side of the first, and where these agree."""
    cosine = _along(own, other)
    both = own + np.where(cosine < 0, -1.0, 1.0)[:, None] * other
    return both / np.sqrt(_along(both, both))[:, None], np.abs(cosine) > agreement


def _along(offset: Float, normal: Float) -> Float:
    return np.asarray(np.einsum("ij,ij->i", offset, normal))


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
        scale = float(size[int(_QUANTILE * (len(size) - 1))]) / _NORMAL_QUANTILE
    return scale


def tukey_weights(residual: Float, scale: float) -> Float:
    """Tukey's biweight: 1 at zero, 0 from ``TUKEY`` scales on."""
    weight: Float = np.maximum(1.0 - (residual / (TUKEY * scale)) ** 2, 0.0) ** 2
    return weight


def regional_weights(pairs: Pairs, scale: float, block: float) -> Float:
    """Weight 1 in blocks whose pairs agree as well as usual, falling to 0 where half as many do.

    Lowered ground keeps pairs that seem to agree, such as those on walls, along which a lowering slides. Their
    neighbours show that the place has changed.
    """
    if not len(pairs):
        return np.ones(0)
    number = block_numbers(pairs.place, block)
    inside = np.abs(pairs.residual) < 3 * scale
    share = (np.bincount(number, inside) / np.bincount(number))[number]
    weight: Float = np.clip((share / max(float(np.median(share)), 1e-9) - 0.5) / 0.3, 0.0, 1.0)
    return weight
