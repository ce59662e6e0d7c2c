"""Which patches of a surface agree on one rigid motion: the largest such part is what has not moved.

Motions that a few patches ask for are tried on all of them (a consensus of samples after Fischler and Bolles 1981,
doi:10.1145/358669.358692, improved from those that agree as by Chum et al. 2003, doi:10.1007/978-3-540-45243-0_31).
Patches that stand near to one another are sampled together, because they moved together or not at all: so a part of a
few per cent is found. The largest part among all other patches shows how certain the choice is.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from ..core.arrays import Bool, Float
from ..geometry.pose import Pose
from .observability import Information
from .part_information import contradicting, part_information
from .patch_agreement import FINAL_POINTS, left_behind, levels
from .point_to_plane import Matcher
from .surface_patches import Equations, Patches, equations

_SEARCH_POINTS = 15  # points of a patch that are paired while looking for parts
# Weak directions, which walls and steps fix on level ground.
_MAX_WEAK_CURVATURE_RATIO = 0.1  # of the largest curvature
_MIN_WEAK_SINE_SQUARED = 0.2  # squared sine from which a patch constrains a weak direction
_SURROUNDINGS_WIDTHS = 2.0  # patch widths
_MIN_STABLE_SURROUNDINGS = 0.5  # share of the firm patches around
_WEAK_LEVEL_FACTOR = 2.0  # of the error floor: few points of a patch are paired
_WEAK_TRIAL_COUNT, _WEAK_SAMPLE_SIZE = 1_000, 3  # samples, patches: twice can be alike, three fix two directions
_MIN_GAIN_RATIO = 1.2  # of the area that agrees without a slide
_MIN_KEPT_AREA_RATIO = 0.95  # of the part's area: a slide must leave the rest as it was
_MAX_SHARED_RATIO = 0.5  # of a motion's area, shared with the best one: above, both are one motion
_MAX_RIVAL_AREA_RATIO = 0.75  # of the area that agrees best: as much agrees on something else
_TRIAL_COUNT = 6_000
_PARTNER_COUNTS = (1, 2, 3, 5, 8)  # patches that a trial takes in addition to its first one
_NEAREST_PATCHES = 25  # nearest patches of which half of the trials take them
_MAX_IMPROVED_TRIALS = 12  # trials that are improved
_MAX_PARTS = 4  # parts that are paired again where they lead to
_MAX_IMPROVEMENTS = 8
_MAX_PASSES = 3
_MIN_STEP_M = 1e-4  # metres
_MIN_TRIED_AREA_RATIO = 0.5  # of the largest area: less does not become the largest when paired again
_MIN_OTHER_AREA_RATIO = 0.4  # of the largest part's area: another one so large is measured again
_SHIFT_PER_TURN = 5.0  # surveys shift by so much more than they turn, at the typical distance of the points
# shares of the patches around that agree: none counts below the first, all from the second on
_MIN_NEIGHBOUR_SHARE, _FULL_NEIGHBOUR_SHARE = 0.5, 0.8
_MAX_JUDGED_TRIALS = 400  # trials that are looked at with the patches around


@dataclass(frozen=True)
class StablePart:
    """Patches that agree on one motion.

    Attributes:
        pose: that motion.
        agrees: (k,) which of the ``patches``.
        share: their share of the area of all patches that could be compared or have moved out of reach.
        information: what the part fixes of the motion, in local coordinates.
        other: the largest part of all other patches that agrees on another motion; None without any.
    """

    pose: Pose
    patches: Patches
    agrees: Bool
    share: float
    information: Information
    other: StablePart | None = None

    @property
    def rival(self) -> float:
        """Share of the other part."""
        return 0.0 if self.other is None else self.other.share

    def points(self, size: int) -> Bool:
        """(size,) the points of the cut surface that lie in those patches."""
        found = np.zeros(size, dtype=bool)
        inside = self.patches.number >= 0
        found[self.patches.sources[inside]] = self.agrees[self.patches.number[inside]]
        return found


@dataclass(frozen=True)
class _Found:
    motion: Float
    weight: Float
    area: float

    @property
    def agrees(self) -> Bool:
        return self.weight > 0


def stable_part(matcher: Matcher, patches: Patches, starts: tuple[Pose, ...], offset: float) -> StablePart | None:
    """The largest part of the moving surface that lies on the reference after one motion; None without any patch.

    Args:
        patches: of the moving surface.
        starts: poses that are tried. From the first one patches are compared up to ``offset`` metres apart, from
            others that are far from it up to the width of a patch.
    """
    radius = matcher.radius
    if not len(patches):
        return None
    task = _Task(matcher, patches, offset)
    everywhere = np.ones(len(patches), dtype=bool)
    systems = _systems(matcher, patches, starts, offset)

    def settled(among: Bool, poses: list[Pose]) -> _Settled | None:
        found = (task.settled(among, pose, _SEARCH_POINTS) for pose in poses)
        return max(found, key=lambda one: one.area, default=None)

    def reached(among: Bool, most: int) -> list[Pose]:
        found = [(system.pose, one) for system in systems for one in task.search(system, among)[:most]]
        largest = max((one.area for _, one in found), default=0.0)
        near = [(base, one.motion) for base, one in found if one.area >= _MIN_TRIED_AREA_RATIO * largest]
        return [base.moved(motion, radius) for base, motion in near]

    best = settled(everywhere, [*reached(everywhere, _MAX_PARTS), *starts[1:]])
    if best is None:
        return None
    best = task.upright(task.settled(everywhere, best.pose, FINAL_POINTS))
    other = settled(~best.agrees, reached(~best.agrees, 2))
    if other is not None and other.area > _MIN_OTHER_AREA_RATIO * best.area:
        # what few points leave open counts as agreement, so that both are measured alike before they are compared
        other = task.settled(~best.agrees, other.pose, FINAL_POINTS, clear=False)
    compared = best.usable | best.left if other is None else best.usable | best.left | other.usable
    whole = max(float(patches.area[compared].sum()), 1e-9)

    def part(one: _Settled, rival: StablePart | None) -> StablePart:
        known = one.information
        held = one.pose.vector(radius) if known.observable.all() else known.held(one.pose.vector(radius))
        return StablePart(Pose.from_vector(held, radius), patches, one.agrees, one.area / whole, known, rival)

    return part(best, None if other is None else part(other, None))


def _systems(matcher: Matcher, patches: Patches, starts: tuple[Pose, ...], offset: float) -> list[Equations]:
    """Equations of the patches from which parts are looked for."""
    found = [equations(matcher, patches, starts[0], max(offset, 3 * matcher.spacing), _SEARCH_POINTS)]
    placed = starts[0].apply(patches.centre)
    for pose in starts[1:]:
        # what is paired farther apart than a patch is wide is paired by chance
        if float(np.sqrt(np.mean(np.sum((pose.apply(patches.centre) - placed) ** 2, axis=1)))) > patches.width:
            found.append(equations(matcher, patches, pose, patches.width, _SEARCH_POINTS))
    return found


@dataclass(frozen=True)
class _Settled:
    """A part, paired again where it lies: its ``area`` in square metres, and which patches could be compared or have
    moved farther than that.
    """

    pose: Pose
    agrees: Bool
    area: float
    usable: Bool
    left: Bool
    information: Information


@dataclass(frozen=True)
class _Task:
    """What a search works on: two surfaces, the moving one's ``patches`` (k), the largest expected ``offset`` (m)."""

    matcher: Matcher
    patches: Patches
    offset: float

    def settled(self, among: Bool, pose: Pose, most: int, *, clear: bool = True) -> _Settled:
        """The part of the patches ``among`` (k,) that agrees with a pose, and the pose that it asks for.

        Args:
            most: points of a patch that are paired.
            clear: leave out of the motion the places that contradict the rest, once as many as ``FINAL_POINTS`` are.
        """
        matcher, patches = self.matcher, self.patches
        for number in range(_MAX_PASSES):
            system = equations(matcher, patches, pose, 3 * matcher.spacing, most)
            level, decisive = levels(system, matcher.noise, 2.0 if number == 0 and most == _SEARCH_POINTS else 1.0)
            usable = among & decisive
            found = _improved(system, patches, usable, level, np.zeros(6), matcher.spacing)
            agrees = found.agrees
            if most == FINAL_POINTS and clear:
                odd = contradicting(system, patches, agrees, self.offset)
                if odd.any():
                    found = _improved(system, patches, usable & ~odd, level, np.zeros(6), matcher.spacing)
                    # each of them agrees: they do not enter the motion, but count towards the part
                    agrees = found.agrees | (odd & agrees)
            weight = found.weight * patches.area / level
            known = part_information(system, patches, weight, found.motion, matcher.spacing, self.offset)
            # what nothing fixes stays
            pose = pose.moved(known.held(found.motion), matcher.radius)
            if number and float(np.linalg.norm(found.motion)) < _MIN_STEP_M:
                break
        left = left_behind(matcher, patches, pose, system) if most == FINAL_POINTS else np.zeros_like(agrees)
        return _Settled(pose, agrees, float(patches.area[agrees].sum()), usable, left, known)

    def upright(self, best: _Settled) -> _Settled:
        """``best`` where the few patches that fix its weak directions agree best; open where others contradict them.

        A level part with one wall that stayed and one that moved fits in height wherever it slides. Only patches
        among stable ones count.
        """
        matcher, patches, offset = self.matcher, self.patches, self.offset
        known = best.information
        weak = known.observable & (known.curvature < _MAX_WEAK_CURVATURE_RATIO * known.curvature[-1])
        if not weak.any():
            return best
        free = known.directions[:, weak]
        system = equations(matcher, patches, best.pose, offset, _SEARCH_POINTS)
        level, decisive = levels(system, matcher.noise, _WEAK_LEVEL_FACTOR)
        sine_squared = np.minimum(np.einsum("ia,kij,ja->k", free, system.matrix, free), 1.0)
        near = cKDTree(patches.centre).query_ball_point(patches.centre, _SURROUNDINGS_WIDTHS * patches.width)
        firm = decisive & (sine_squared < _MIN_WEAK_SINE_SQUARED)
        stays = np.array([np.mean(best.agrees[some][firm[some]]) if firm[some].any() else 0.0 for some in near])
        tells = decisive & (sine_squared >= _MIN_WEAK_SINE_SQUARED) & (stays > _MIN_STABLE_SURROUNDINGS)
        some = np.flatnonzero(tells)
        if len(some) < 2:
            return best
        matrices = np.einsum("ia,kij,jb->kab", free, system.matrix[some], free) / level[some, None, None]
        vectors = system.vector[some] @ free / level[some, None]
        rng = np.random.default_rng(0)
        chosen = rng.integers(0, len(some), (_WEAK_TRIAL_COUNT, _WEAK_SAMPLE_SIZE))
        prior = np.eye(free.shape[1]) * 3 / offset**2
        steps = -np.linalg.solve(matrices[chosen].sum(axis=1) + prior, vectors[chosen].sum(axis=1)[:, :, None])[:, :, 0]
        motions = np.vstack([np.zeros((1, 6)), steps @ free.T])
        fit = np.maximum(1.0 - system.excess(motions)[some] / level[some, None], 0.0)
        weight = patches.area[some] * sine_squared[some]
        area = weight @ fit
        first = int(np.argmax(area))
        shared = weight @ ((fit > 0) & (fit[:, first] > 0)[:, None])
        apart = shared < _MAX_SHARED_RATIO * (weight @ (fit > 0))
        rival = float(area[apart].max(initial=0.0))
        if first and area[first] > _MIN_GAIN_RATIO * area[0]:
            pose = best.pose.moved(motions[first], matcher.radius)
            other = self.settled(np.ones(len(patches), dtype=bool), pose, FINAL_POINTS)
            # what slides must leave the rest as it was
            best = other if other.area > _MIN_KEPT_AREA_RATIO * best.area else best
        if rival <= _MAX_RIVAL_AREA_RATIO * area[first]:
            return best
        known = best.information
        weak = known.observable & (known.curvature < _MAX_WEAK_CURVATURE_RATIO * known.curvature[-1])
        kept = known.directions[:, known.observable & ~weak]
        left = known.directions[:, ~known.observable | weak]
        covariance = kept @ kept.T @ known.covariance @ kept @ kept.T + offset**2 / 3 * left @ left.T
        return replace(
            best, information=Information(known.curvature, known.directions, known.observable & ~weak, covariance)
        )

    def search(self, system: Equations, among: Bool) -> list[_Found]:
        """Some motions on which large parts agree, the largest part first; each with patches that those before lack."""
        patches, offset = self.patches, self.offset
        level, decisive = levels(system, self.matcher.noise, 3.0)
        usable = among & decisive
        numbers = np.flatnonzero(usable)
        if not len(numbers):
            return []
        trials = np.vstack([np.zeros((1, 6)), _trials(system, patches, numbers, level, offset)])
        areas = _areas(system, patches, usable, level, trials)
        found: list[_Found] = []
        for number in np.argsort(-areas, kind="stable")[: np.count_nonzero(areas)]:
            inside = agreement_weights(patches, usable, system.excess(trials[number : number + 1]), level)[:, 0] > 0
            if any(patches.area[inside & f.agrees].sum() > 0.5 * patches.area[inside].sum() for f in found):
                continue
            found.append(_improved(system, patches, usable, level, trials[number], offset))
            if len(found) >= _MAX_IMPROVED_TRIALS:
                break
        found.sort(key=lambda f: -f.area)
        return found[:_MAX_PARTS]


def _trials(system: Equations, patches: Patches, numbers: NDArray[np.int64], level: Float, offset: float) -> Float:
    """Motions (m, 6) that samples of patches ask for."""
    rng = np.random.default_rng(0)
    share = patches.area[numbers] / patches.area[numbers].sum()
    first = rng.choice(len(numbers), _TRIAL_COUNT, p=share)
    distance = np.linalg.norm(patches.centre[numbers][:, None] - patches.centre[numbers][None], axis=2)
    near = np.argsort(distance, axis=1)[:, : min(_NEAREST_PATCHES, len(numbers))]
    weight = 1.0 / level[numbers]
    matrices = system.matrix[numbers] * weight[:, None, None]
    vectors = system.vector[numbers] * weight[:, None]
    prior = _prior(offset)
    # wide parts hold small motions back less than their own noise does
    total, side = np.broadcast_to(prior, (_TRIAL_COUNT, 6, 6)) + matrices[first], vectors[first]
    wanted = rng.choice(_PARTNER_COUNTS, _TRIAL_COUNT)
    for partner in range(max(_PARTNER_COUNTS)):
        neighbour = near[first, rng.integers(0, near.shape[1], _TRIAL_COUNT)]
        anywhere = rng.choice(len(numbers), _TRIAL_COUNT, p=share)
        other = np.where(rng.random(_TRIAL_COUNT) < 0.7, neighbour, anywhere)
        more = (partner < wanted)[:, None]
        total = total + np.where(more[:, :, None], matrices[other], 0.0)
        side = side + np.where(more, vectors[other], 0.0)
    return np.asarray(-np.linalg.solve(total, side[:, :, None])[:, :, 0])


def _prior(offset: float) -> Float:
    sd = offset / np.sqrt(3.0) * np.array([1 / _SHIFT_PER_TURN] * 3 + [1.0] * 3)
    return np.diag(1.0 / sd**2)


def agreement_weights(patches: Patches, usable: Bool, excess: Float, level: Float) -> Float:
    """(k, m) weights of the patches, from 1 where one agrees well, by its ``excess`` (k, m), to 0 at its ``level``.

    A piece that turned agrees along a line, a piece that slid in places: their neighbours show it.
    """
    fit = np.where(usable[:, None], np.maximum(1.0 - excess / level[:, None], 0.0), 0.0)
    known = np.maximum(patches.around @ usable.astype(np.float64), 1e-9)
    share = (patches.around @ (fit > 0).astype(np.float64)) / known[:, None]
    low, full = _MIN_NEIGHBOUR_SHARE, _FULL_NEIGHBOUR_SHARE
    return np.asarray(fit * np.clip((share - low) / (full - low), 0.0, 1.0))


def _areas(system: Equations, patches: Patches, usable: Bool, level: Float, motions: Float) -> Float:
    """(m,) area that agrees with each motion; what agrees better counts more; 0 for those that are not examined."""
    area = np.where(usable, patches.area, 0.0)
    found = np.empty(len(motions))
    for start in range(0, len(motions), 500):
        excess = system.excess(motions[start : start + 500])
        found[start : start + 500] = area @ np.maximum(1.0 - excess / level[:, None], 0.0)
    some = np.argsort(-found, kind="stable")[:_MAX_JUDGED_TRIALS]
    looked_at = area @ agreement_weights(patches, usable, system.excess(motions[some]), level)
    found[:] = 0.0
    found[some] = looked_at
    return found


def _improved(system: Equations, patches: Patches, usable: Bool, level: Float, motion: Float, offset: float) -> _Found:
    """The motion that all patches which agree with it ask for together."""
    best = motion, np.zeros(len(patches)), -1.0
    mean = float(patches.area[usable].mean()) if usable.any() else 1.0
    for _ in range(_MAX_IMPROVEMENTS):
        weight = agreement_weights(patches, usable, system.excess(motion[None]), level)[:, 0]
        area = float(patches.area @ weight)
        if area <= best[2]:
            break
        best = motion, weight, area
        share = patches.area * weight / (level * mean)
        total = _prior(offset) + np.einsum("k,kij->ij", share, system.matrix)
        motion = -np.linalg.solve(total, share @ system.vector)
    return _Found(*best)
