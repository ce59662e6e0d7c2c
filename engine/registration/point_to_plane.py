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

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ..core.arrays import Bool, Float, Index
from ..geometry.pose import Pose
from ..geometry.voxels import block_numbers
from .kernels import plane_pairs
from .surface import Surface
from .tracked_neighbours import TrackedNeighbours

TUKEY = 4.685  # 95 % efficiency on normal noise


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
        return jacobian(self.place, self.normal, radius)


def jacobian(place: Float, normal: Float, radius: float) -> Float:
    """(n, 6) derivative, by the vector of ``Pose.moved``, of the distances of ``place`` along ``normal`` (n, 3)."""
    x, y, z = place.T / radius
    u, v, w = normal.T
    # in columns, along which it is summed
    return np.stack([y * w - z * v, z * u - x * w, x * v - y * u, u, v, w]).T


@dataclass(frozen=True)
class Matcher:
    """Two surfaces to be compared.

    ``stable`` (points of the reference,) and ``firm`` (points of the moving surface,) restrict the comparison to them.
    ``given_radius`` is the ``radius``, metres, if another than that of the reference.
    """

    reference: Surface
    moving: Surface
    stable: Bool | None = None
    firm: Bool | None = None
    given_radius: float | None = None

    @property
    def radius(self) -> float:
        """By which rotations are scaled, metres: the typical distance of the reference's points from the origin."""
        return self.given_radius or self.reference.radius

    @property
    def knows_plants(self) -> bool:
        """Whether either surface's points record the plants over them."""
        return self.reference.plants is not None or self.moving.plants is not None

    @property
    def spacing(self) -> float:
        """Of the points of the sparser surface, metres."""
        return max(self.reference.spacing, self.moving.spacing)

    @property
    def noise(self) -> float:
        """Of a point about its surface, metres, of the noisier one."""
        return max(self.reference.noise, self.moving.noise)

    def reach(self, scale: float) -> float:
        """Farthest point of a pair, metres: the next few points, and what the weights do not yet leave out.

        Args:
            scale: of the residuals, metres.
        """
        return max(3 * self.spacing, 3 * scale)

    def sample(self, limit: int) -> tuple[Index, Index]:
        """At most ``limit`` sources of each surface."""
        return self.reference.sample(limit, self.stable), self.moving.sample(limit, self.firm)

    @cached_property
    def _of_moving(self) -> TrackedNeighbours:
        return TrackedNeighbours(self.reference.tree, len(self.moving.points))

    @cached_property
    def _of_reference(self) -> TrackedNeighbours:
        return TrackedNeighbours(self.moving.tree, len(self.reference.points))

    def neighbours(self, pose: Pose, sources: Index, reach: float) -> tuple[Float, Index]:
        """(n,) distances from the moving surface's points to the nearest one of the reference, and its (n,) numbers;
        infinity beyond ``reach``.
        """
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
        near = self.neighbours(pose, sources, reach)
        return _pairs(_Placed(self.moving, pose), _Placed(self.reference), sources, near, self.stable, agreement)

    def onto_moving(self, pose: Pose, sources: Index, reach: float, agreement: float) -> Pairs:
        """The reference's points against the planes of the moving surface."""
        near = self.neighbours_back(pose, sources, reach)
        pairs = _pairs(_Placed(self.reference), _Placed(self.moving, pose), sources, near, self.firm, agreement)
        return replace(pairs, residual=-pairs.residual, gap=-pairs.gap)

    def match(self, pose: Pose, sources: tuple[Index, Index], reach: float, agreement: float = 0.8) -> Pairs:
        """Both directions together."""
        one = self.onto_moving(pose, sources[0], reach, agreement)
        two = self.onto_reference(pose, sources[1], reach, agreement)
        return Pairs(*(np.concatenate(both) for both in zip(vars(one).values(), vars(two).values(), strict=True)))


@dataclass(frozen=True)
class _Placed:
    """A surface in the reference frame: where its ``pose`` takes it, or as it is."""

    surface: Surface
    pose: Pose | None = None


def _pairs(
    points: _Placed, planes: _Placed, sources: Index, near: tuple[Float, Index], among: Bool | None, agreement: float
) -> Pairs:
    """Points ``sources`` (n,) against the planes of their neighbours; residuals are points minus planes.

    Args:
        near: (n,) distance and number of each point's neighbour, infinity without one.
        among: (m,) the neighbours that count; all without it.
    """
    distance, number = near
    found = np.isfinite(distance)
    if among is not None:
        found[found] = among[number[found]]
    sources, number = sources[found], number[found]
    planes.surface.fit(number)
    points.surface.fit(sources)
    motion = points.pose or planes.pose or Pose.identity()
    found_pairs = plane_pairs(
        sources,
        number,
        (points.surface.planes, planes.surface.planes),
        (motion.rotation, motion.translation),
        points.pose is not None,
        agreement,
    )
    return Pairs(*found_pairs)


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
