"""A surface cut into patches of one direction, and how far each patch agrees with a motion of the whole.

Patches are the unit of piecewise registration (Yang and Schwieger 2023, Wujanz et al. 2016,
doi:10.1016/j.isprsjprs.2016.04.008): a patch has moved or not as a whole, and its many points show that far more
reliably than each one alone.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.sparse import coo_array, csr_array, diags_array
from scipy.spatial import cKDTree

from ..core.arrays import Bool, Float, Index
from ..geometry.pose import Pose, turned
from ..geometry.voxels import block_numbers
from ..statistics.robust import NORMALISED
from .point_to_plane import Matcher, jacobian, tukey_weights
from .surface import Surface

_MAX_LAYERS = 4  # directions that a block may hold
_MIN_PAIR_COSINE = 0.8  # least cosine of the normals of a pair
_MIN_PATCH_COSINE = 0.9  # least cosine of the normals of one patch: 26 degrees
_MIN_PATCH_POINTS = 12  # points of a patch
_SURROUNDINGS_WIDTHS = 2.5  # widths
_BLOCK_SPACINGS = 10  # spacings: side of a block
_MAX_PATCHES = 1500  # patches, about
_SOURCES = 60_000
_LAYER_ROUNDS = 4
_MAX_PATCH_PAIRS = 60
_UPPER_TRIANGLE = np.triu_indices(6)
_SYMMETRY_FACTORS = np.where(_UPPER_TRIANGLE[0] == _UPPER_TRIANGLE[1], 1.0, 2.0)


@dataclass(frozen=True)
class Patches:
    """Patches of a surface's points ``sources`` (n,); ``number`` (n,) is the patch of each, -1 for none.

    ``centre`` and ``normal`` (k, 3) and ``area`` (k,), square metres, are the patches'; ``width`` (m) is the largest
    one's side.
    """

    sources: Index
    number: Index
    centre: Float
    normal: Float
    area: Float
    width: float

    def __len__(self) -> int:
        return len(self.area)

    def of_points(self, size: int) -> Index:
        """(size,) the patch of each point of the surface, -1 for none."""
        found = np.full(size, -1, dtype=np.int64)
        found[self.sources] = self.number
        return found

    def some(self, most: int) -> Index:
        """At most about ``most`` of the sources of each patch, evenly spread, in ascending order."""
        inside = np.flatnonzero(self.number >= 0)
        number = self.number[inside]
        share = most / np.maximum(np.bincount(number, minlength=len(self)), 1)
        lot = np.random.default_rng(0).random(len(inside))
        return self.sources[inside[lot < share[number]]]

    @cached_property
    def around(self) -> csr_array:
        """(k, k) shares of the patches near each one that face alike, itself with them, by area; rows sum to 1."""
        pairs = cKDTree(self.centre).query_pairs(_SURROUNDINGS_WIDTHS * self.width, output_type="ndarray")
        alike = np.abs(np.einsum("ij,ij->i", self.normal[pairs[:, 0]], self.normal[pairs[:, 1]])) > _MIN_PATCH_COSINE
        first, second = pairs[alike].T
        own = np.arange(len(self))
        rows, columns = np.concatenate([first, second, own]), np.concatenate([second, first, own])
        shares = coo_array((self.area[columns], (rows, columns)), shape=(len(self), len(self))).tocsr()
        return csr_array(diags_array(1.0 / np.asarray(shares.sum(axis=1))) @ shares)


def cut(surface: Surface, thickness: float, eligible: Bool | None = None) -> Patches:
    """Cut a surface into patches: cubic blocks, and in each the parts that face one way and lie in one layer.

    Args:
        thickness: of a layer, metres either way, in addition to a patch's own relief.
        eligible: (m,) points to be used; all without it.
    """
    sources = surface.sample(_SOURCES, eligible)
    surface.fit(sources)
    sources = sources[surface.planar[sources]]
    places, normals = surface.points[sources], surface.normals[sources]
    per_point = surface.spacing**2 * max(1.0, len(surface.points) / max(len(sources), 1))
    width = max(_BLOCK_SPACINGS * surface.spacing, float(np.sqrt(len(sources) * per_point / _MAX_PATCHES)))
    block = block_numbers(places, width) if len(sources) else np.zeros(0, dtype=np.int64)
    number = np.full(len(sources), -1, dtype=np.int64)
    found = 0
    for _ in range(_MAX_LAYERS):
        left = np.flatnonzero(number < 0)
        if not len(left):
            break
        of = np.unique(block[left], return_inverse=True)[1]
        inside = _layer(places[left], normals[left], of, max(thickness, 0.05 * width))
        size = np.bincount(of, inside)
        enough = size >= _MIN_PATCH_POINTS
        chosen = inside & enough[of]
        numbers = np.cumsum(enough) - 1 + found
        number[left[chosen]] = numbers[of[chosen]]
        # a block whose thickest layer is too thin has no patch left
        if not enough.any():
            break
        found += int(np.count_nonzero(enough))
    known = number >= 0
    count = np.bincount(number[known], minlength=found)
    centre = np.column_stack([np.bincount(number[known], x, minlength=found) for x in places[known].T])
    normal = _directions(normals[known], number[known], found)
    return Patches(
        sources,
        number,
        centre / np.maximum(count, 1)[:, None],
        normal,
        np.asarray(count * per_point, dtype=np.float64),
        width,
    )


def _directions(normals: Float, patch: Index, k: int) -> Float:
    """(k, 3) mean directions; the sign of a wall's normal is chance, so that each is taken as the first one's."""
    first = np.zeros((k, 3))
    first[patch[::-1]] = normals[::-1]
    turned_alike = normals * np.sign(np.einsum("ij,ij->i", normals, first[patch]))[:, None]
    mean = np.column_stack([np.bincount(patch, x, minlength=k) for x in turned_alike.T])
    return np.asarray(mean / np.maximum(np.linalg.norm(mean, axis=1), 1e-12)[:, None])


def _layer(places: Float, normals: Float, of: Index, thickness: float) -> Bool:
    """Points (n,) of the layer about one point of each block ``of`` (n,), which faces as most of the block does."""
    count = np.bincount(of)
    axis = np.column_stack([np.bincount(of, x) for x in normals.T]) / count[:, None]
    # the point that faces most like the others; normals of walls point either way, so that a mean can vanish
    fit = np.abs(np.einsum("ij,ij->i", normals, axis[of]))
    middle = np.column_stack([np.bincount(of, x) for x in places.T]) / count[:, None]
    far = np.linalg.norm(places - middle[of], axis=1)
    order = np.lexsort((far - fit * 10 * thickness, of))
    seed = order[np.concatenate([[0], np.cumsum(count)[:-1]])]
    origin, normal = places[seed], normals[seed]
    inside = np.zeros(len(of), dtype=bool)
    for _ in range(_LAYER_ROUNDS):
        away = np.einsum("ij,ij->i", places - origin[of], normal[of])
        cosine = np.einsum("ij,ij->i", normals, normal[of])
        inside = (np.abs(cosine) > _MIN_PATCH_COSINE) & (np.abs(away) < thickness)
        size = np.maximum(np.bincount(of, inside), 1)
        turned = normals * np.where(inside, np.sign(cosine), 0.0)[:, None]
        mean = np.column_stack([np.bincount(of, x, minlength=len(count)) for x in turned.T])
        length = np.linalg.norm(mean, axis=1)
        normal = np.where(length[:, None] > 0, mean / np.maximum(length, 1e-12)[:, None], normal)
        shifted = np.column_stack([np.bincount(of, x * inside, minlength=len(count)) for x in places.T])
        origin = np.where((length > 0)[:, None], shifted / size[:, None], origin)
    return inside


@dataclass(frozen=True)
class Equations:
    """Mean squared distance of each patch as a quadratic of the motion (6,) from ``pose``, rotations times a radius.

    Attributes:
        matrix: (k, 6, 6) mean of J'J.
        vector: (k, 6) mean of J'g.
        rest: (k,) mean of g² after the patch's own best motion, square metres.
        own: (k, 6) that motion.
        pairs: (k,) their number; patches with none take no part.
        roughness: variance of a normal's components across it that is noise, by the difference of both surfaces'.
    """

    matrix: Float
    vector: Float
    rest: Float
    own: Float
    pairs: Float
    roughness: float
    pose: Pose

    def excess(self, motions: Float) -> Float:
        """(k, m) mean squared distance, square metres, that ``motions`` (m, 6) leave beyond a patch's own best one."""
        quadratic = self.matrix[:, _UPPER_TRIANGLE[0], _UPPER_TRIANGLE[1]] * _SYMMETRY_FACTORS
        outer = motions[:, _UPPER_TRIANGLE[0]] * motions[:, _UPPER_TRIANGLE[1]]
        least = np.einsum("ki,ki->k", self.vector, self.own)
        return np.asarray(np.maximum(quadratic @ outer.T + 2 * self.vector @ motions.T - least[:, None], 0.0))


def equations(matcher: Matcher, patches: Patches, pose: Pose, reach: float, most: int = _MAX_PATCH_PAIRS) -> Equations:
    """The patches' equations at a pose, out of pairs up to ``reach`` metres apart, ``most`` points of a patch.

    Products are taken of one surface's normal with the other's: the noise of both is independent, so that a noisy plane
    does not seem to fix what slides along it.
    """
    pairs = _paired(matcher, patches, pose, reach, most)
    k = len(patches)
    one, two = (jacobian(pairs.place, normal, matcher.radius) for normal in pairs.normals)
    mean, gap = (one + two) / 2, pairs.gaps.mean(axis=0)
    # pairs across an edge belong to something else: they stand apart from the rest of their patch
    left = gap - _medians(gap, pairs.patch, k)[pairs.patch]
    spread = NORMALISED * _medians(np.abs(left), pairs.patch, k)
    sums, own = None, np.zeros((k, 6))
    for _ in range(2):
        weight = tukey_weights(left / np.maximum(spread, matcher.noise / 2)[pairs.patch], 1.0)
        sums = _sums(one, two, pairs, weight, k)
        own = _own(sums.matrix, sums.vector)
        left = gap + np.einsum("ij,ij->i", mean, own[pairs.patch])
        square = np.bincount(pairs.patch, weight * left**2, minlength=k)
        spread = np.sqrt(square / np.maximum(sums.total, 1e-12))
    assert sums is not None
    rest = spread**2 * sums.count / np.maximum(sums.count - 6, 1)
    away = np.sum((pairs.normals[0] - pairs.normals[1]) ** 2, axis=1)
    roughness = float(np.mean(away)) / 4 if len(away) else 0.0  # two normals, two directions across
    return Equations(sums.matrix, sums.vector, rest, own, sums.count, roughness, pose)


@dataclass(frozen=True)
class _Paired:
    """``place`` (n, 3), both surfaces' ``normals`` (2, n, 3) there, ``gaps`` (2, n) along them; ``patch`` (n,) ascends.

    The distance is that of the places halfway between point and own plane, as in ``point_to_plane.Pairs``.
    """

    place: Float
    normals: Float
    gaps: Float
    patch: Index


def _paired(matcher: Matcher, patches: Patches, pose: Pose, reach: float, most: int) -> _Paired:
    """Both surfaces' points with the other's planes, so that what curvature does to each cancels."""
    reference, moving = matcher.reference, matcher.moving
    patch_of = patches.of_points(len(moving.points))
    ours = patches.some(most)
    distance, theirs = matcher.neighbours(pose, ours, reach)
    ours, theirs = ours[np.isfinite(distance)], theirs[np.isfinite(distance)]
    back = reference.sample(min(_SOURCES, most * len(patches)), matcher.stable)
    distance, number = matcher.neighbours_back(pose, back, reach)
    near = np.isfinite(distance)
    near[near] = patch_of[number[near]] >= 0
    forward = np.concatenate([np.ones(len(ours), dtype=bool), np.zeros(np.count_nonzero(near), dtype=bool)])
    ours, theirs = np.concatenate([ours, number[near]]), np.concatenate([theirs, back[near]])
    reference.fit(theirs)
    moving.fit(ours)
    first, second = reference.normals[theirs], turned(moving.normals[ours], pose.rotation)
    cosine = np.einsum("ij,ij->i", first, second)
    keep = (np.abs(cosine) > _MIN_PAIR_COSINE) & reference.planar[theirs] & moving.planar[ours]
    if matcher.stable is not None:
        keep &= matcher.stable[theirs]
    keep = np.flatnonzero(keep)
    keep = keep[np.argsort(patch_of[ours[keep]], kind="stable")]
    ours, theirs, forward, first = ours[keep], theirs[keep], forward[keep, None], first[keep]
    second = second[keep] * np.where(cosine[keep] < 0, -1.0, 1.0)[:, None]
    own, other = pose.apply(moving.points[ours]), reference.points[theirs]
    middle, plane = pose.apply(moving.centroids[ours]), reference.centroids[theirs]
    offset = np.where(forward, (own + middle) / 2 - plane, middle - (other + plane) / 2)
    normals = np.stack([first, second])
    gaps = np.einsum("ij,kij->ki", offset, normals)
    return _Paired(np.where(forward, own, other), normals, gaps, patch_of[ours])


@dataclass(frozen=True)
class _Sums:
    matrix: Float
    vector: Float
    total: Float
    count: Float


def _sums(one: Float, two: Float, pairs: _Paired, weight: Float, k: int) -> _Sums:
    """Weighted means by patch, and the ``total`` weight."""
    patch = pairs.patch
    total: Float = np.asarray(np.bincount(patch, weight, minlength=k), dtype=np.float64)
    share = weight / np.maximum(total, 1e-12)[patch]
    i, j = _UPPER_TRIANGLE
    products = np.empty((len(patch), len(i) + 6))
    products[:, : len(i)] = one[:, i] * two[:, j] + one[:, j] * two[:, i]
    products[:, len(i) :] = one * pairs.gaps[1][:, None] + two * pairs.gaps[0][:, None]
    products *= share[:, None] / 2
    sums = np.zeros((k, products.shape[1]))
    if len(patch):
        starts = np.flatnonzero(np.concatenate([[True], patch[1:] != patch[:-1]]))
        sums[patch[starts]] = np.add.reduceat(products, starts, axis=0)
    matrix = np.zeros((k, 6, 6))
    matrix[:, i, j] = matrix[:, j, i] = sums[:, : len(i)]
    count: Float = np.bincount(patch, weight > 0, minlength=k).astype(np.float64)
    return _Sums(matrix, sums[:, len(i) :], total, count)


def _own(matrix: Float, vector: Float) -> Float:
    """The motion (k, 6) that suits each patch best, as small as can be."""
    values, vectors = np.linalg.eigh(matrix)
    along = np.einsum("kij,ki->kj", vectors, vector)
    # what a patch does not fix it does not ask for: a plane leaves three motions open
    firm = values > 1e-5 * np.maximum(values[:, -1:], 1e-12)
    return np.asarray(-np.einsum("kij,kj->ki", vectors, np.where(firm, along / np.where(firm, values, 1.0), 0.0)))


def _medians(values: Float, patch: Index, k: int) -> Float:
    """(k,) medians by patch; 0 for one without any."""
    order = np.lexsort((values, patch))  # the patches are in order already, which makes that cheap
    count = np.bincount(patch, minlength=k)
    start = np.concatenate([[0], np.cumsum(count)[:-1]])
    found = np.zeros(k)
    some = count > 0
    found[some] = values[order][(start + count // 2)[some]]
    return found
