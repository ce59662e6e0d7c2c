"""How well two surfaces fix their relative position: covariance, and directions that they do not fix."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..core.arrays import Float
from .point_to_plane import Pairs

_FOLDS = 16
MIN_STANDARD_ERRORS = 5.0  # standard errors by which a curvature must stand above zero
# The same if its error is that of relief in few places. Noise alone makes gradients that change over 0.33 spacings or
# more (282 directions of planes and waves, 8 clouds); a curvature whose error is larger than that has relief.
_MIN_ERRORS_OF_RELIEF, _NOISE_LENGTH_RATIO = 3.0, 0.6  # the length: of ``largest_sd``, which is half a spacing
MIN_CURVATURE_RATIO = 1e-4  # of the largest curvature: slopes that differ by 1 % only
_SHIFT_PER_TURN = 10.0  # surveys turn by some hundredths of a degree, a few mm at 10 m, but are offset by centimetres
_MIN_DIP_SINE = 0.02  # least sine of the dip with which a surface has a strike


@dataclass(frozen=True)
class Estimate:
    """The estimating equations at one pose.

    ``gradient`` (_FOLDS, 6) is the sum of w r J over the pairs of each fold of blocks, ``count`` the number of pairs.
    """

    gradient: Float
    count: int


@dataclass(frozen=True)
class Information:
    """How the cost rises with the six small motions (rotation vector times radius, translation), all in metres.

    ``curvature`` (6,) a pair, ascending, is in units of squared sine; column i of ``directions`` (6, 6) belongs to
    curvature i. ``observable`` (6,) marks those that the surfaces fix. ``covariance`` (6, 6) in square metres has
    in the other ones that of ``unknown_motion``. ``likely`` (6,) is how far the solution is off in each direction,
    metres, if the curvature is right; None if that is not known.
    """

    curvature: Float
    directions: Float
    observable: NDArray[np.bool_]
    covariance: Float
    likely: Float | None = None

    @property
    def condition(self) -> float:
        """Largest curvature by the smallest."""
        return float(self.curvature[-1] / max(self.curvature[0], 1e-12 * self.curvature[-1]))

    def step(self, gradient: Float, count: int) -> Float:
        """Newton's step (6,) in the observable directions for the sum of the gradients over ``count`` pairs."""
        fixed = self.directions[:, self.observable]
        step: Float = -fixed @ ((fixed.T @ gradient) / (self.curvature[self.observable] * count))
        return step

    def damped_step(self, gradient: Float, normal: Float) -> Float:
        """Gauss and Newton's step (6,) in the observable directions for the normal matrix (6, 6).

        The shortest one where too few pairs are left to fix them all; none without any pair.
        """
        fixed = self.directions[:, self.observable]
        if not fixed.shape[1]:
            return np.zeros(6)
        step, *_ = np.linalg.lstsq(fixed.T @ normal @ fixed, fixed.T @ gradient, rcond=None)
        return np.asarray(-fixed @ step)

    def held(self, vector: Float) -> Float:
        """A motion (6,) as far as the surfaces fix it; in what they leave open it turns and shifts the survey least.

        A motion that is not fixed may be a slide with a turn. To take it out whole would make the turn up where the
        surveys differ by a shift, so that turning counts ``_SHIFT_PER_TURN`` times as much as shifting.
        """
        fixed, free = self.directions[:, self.observable], self.directions[:, ~self.observable]
        motion = fixed @ (fixed.T @ vector)
        dear = np.repeat([_SHIFT_PER_TURN**2, 1.0], 3)[:, None] * free
        return np.asarray(motion - free @ np.linalg.solve(free.T @ dear, dear.T @ motion))

    def wider(self, covariance: Float) -> Information:
        """With another error (6, 6) of the observable directions added, square metres."""
        fixed = self.directions[:, self.observable]
        project = fixed @ fixed.T
        return replace(self, covariance=self.covariance + project @ covariance @ project)

    @property
    def observable_covariance(self) -> Float:
        fixed = self.directions[:, self.observable]
        project = fixed @ fixed.T
        return np.asarray(project @ self.covariance @ project)


def folds_of(place: Float, block: float) -> NDArray[np.int64]:
    """Fold (n,) of each place, by blocks of ``block`` metres of a lattice that does not depend on the places."""
    cell = np.floor(place / block).astype(np.int64)
    mixed = cell[:, 0] * 73856093 ^ cell[:, 1] * 19349663 ^ cell[:, 2] * 83492791
    mixed ^= mixed >> 15
    return np.asarray((mixed * 2654435761 >> 16) % _FOLDS, dtype=np.int64)


def estimate(pairs: Pairs, weight: Float, radius: float, block: float) -> Estimate:
    """The gradient of the robust cost by the motion, in folds."""
    fold = folds_of(pairs.place, block)
    terms = pairs.jacobian(radius) * (weight * pairs.gap)[:, None]
    sums = [np.bincount(fold, terms[:, i], minlength=_FOLDS) for i in range(6)]
    return Estimate(np.stack(sums, axis=1), len(pairs))


def curvature_folds(evaluate: Callable[[Float], Estimate], motions: Float) -> Float:
    """(_FOLDS, 6, 6): derivative of the mean gradient by the motion, by central differences.

    Gauss and Newton's J'J would count the noise of the normals as relief: with it a noisy plane seems to be fixed
    along itself, and the covariance comes out too small by up to four times. Pairs that are looked up anew at both
    sides see only relief that both epochs share.

    Args:
        motions: (6, 6), the steps in its rows, orthogonal, metres.
    """
    length = np.linalg.norm(motions, axis=1)
    basis = (motions / length[:, None]).T
    folds = np.zeros((_FOLDS, 6, 6))
    for i, motion in enumerate(motions):
        ahead, behind = evaluate(motion), evaluate(-motion)
        change = ahead.gradient / max(ahead.count, 1) - behind.gradient / max(behind.count, 1)
        folds[:, :, i] = change @ basis / (2 * length[i])
    folds = (folds + folds.transpose(0, 2, 1)) / 2
    return np.asarray(basis @ folds @ basis.T)


def probing_motions(jacobian: Float, weight: Float, least: float, largest: float) -> Float:
    """(6, 6) steps along the principal directions of Gauss and Newton's matrix for ``curvature_folds``.

    All change the residuals about as much as ``least`` metres along the normal do: the direction that shows least
    relief is probed with the longest step, up to ``largest`` metres, where the relief stands out from the noise.
    """
    values, vectors = np.linalg.eigh(jacobian.T @ (jacobian * weight[:, None]))
    length = np.clip(least * np.sqrt(values[-1] / np.maximum(values, 1e-12 * values[-1])), least, max(least, largest))
    return np.asarray((vectors * length).T)


def unknown_motion(offset: float) -> Float:
    """Covariance (6, 6) of a motion of which only the largest expected ``offset`` is known, square metres.

    Shifts are uniform up to the offset, and so is what a turn moves at the typical distance of the points.
    """
    return np.asarray(offset**2 / 3.0 * np.eye(6))


def information(
    folds: Float, terms: Float, blocks: NDArray[np.int64], largest_sd: float, unknown: Float
) -> Information:
    """Curvature, covariance and observability at the solution.

    The covariance is the sandwich H^-1 G H^-1 of an M-estimator (Huber 1967) with G summed over blocks (Liang and
    Zeger 1986, doi:10.1093/biomet/73.1.13), so that residuals of one block may be correlated.

    Args:
        folds: from ``curvature_folds``.
        terms: (n, 6) w r J of all pairs at the solution.
        blocks: (n,) number of the block of each pair.
        largest_sd: a direction with a larger standard deviation is not observable, metres.
        unknown: (6, 6) covariance of the motion before the registration, for directions that are not observable.
    """
    curvature, directions = np.linalg.eigh(folds.sum(axis=0))
    pieces = np.einsum("ia,fij,ja->fa", directions, folds, directions)
    error = np.sqrt(_FOLDS * pieces.var(axis=0, ddof=1))
    scatter = np.stack([np.bincount(blocks, terms[:, i]) for i in range(terms.shape[1])], axis=1)
    along = scatter @ directions
    scattered = along.T @ along
    observable = _clear(curvature, error, np.sqrt(np.diag(scattered)) / len(terms), largest_sd)
    safe = np.where(observable, curvature, 1.0) * len(terms)
    inverse = np.where(observable, _unsureness(curvature, error) / safe, 0.0)
    inner = inverse[:, None] * scattered * inverse
    observable &= np.sqrt(np.diag(inner)) <= largest_sd
    inner[~observable] = 0.0
    inner[:, ~observable] = 0.0
    inner[np.ix_(~observable, ~observable)] = (directions.T @ unknown @ directions)[np.ix_(~observable, ~observable)]
    whole = np.maximum(curvature, 1e-12 * curvature[-1]) * len(terms)
    likely = np.hypot(along.sum(axis=0), np.sqrt(np.diag(scattered))) / whole
    return Information(curvature, directions, observable, directions @ inner @ directions.T, likely)


def _clear(curvature: Float, error: Float, gradient: Float, largest_sd: float) -> NDArray[np.bool_]:
    """Which curvatures (6,) stand above their standard ``error``.

    Args:
        gradient: (6,) standard error of the mean gradient along each direction.
        largest_sd: half a spacing of the points, metres.
    """
    # where even the strongest one is unsure, what there is lies in few places as a whole
    sure = curvature[-1] > MIN_STANDARD_ERRORS * error[-1]
    relief = sure & (error * _NOISE_LENGTH_RATIO * largest_sd > gradient)
    least = np.where(relief, _MIN_ERRORS_OF_RELIEF, MIN_STANDARD_ERRORS)
    return (curvature > least * error) & (curvature > MIN_CURVATURE_RATIO * curvature[-1])


def _unsureness(curvature: Float, error: Float) -> Float:
    """Factor (6,) of the standard deviations of directions whose curvature is uncertain itself.

    The curvature may be smaller by two of its errors. Above ``MIN_STANDARD_ERRORS`` the factor is 1.
    """
    ratio = curvature / np.maximum(error, 1e-300)
    return np.maximum((MIN_STANDARD_ERRORS - 2.0) / np.maximum(ratio - 2.0, 1.0), 1.0)


def name_unobservable(found: Information, normal: Float) -> tuple[str, ...]:
    """The motions that lie mostly within what is not observable, in words.

    Args:
        normal: (3,) mean normal of the surface, upwards.
    """
    free = found.directions[:, ~found.observable]
    if not free.shape[1]:
        return ()
    names = []
    for name, motion in _named_motions(normal).items():
        if np.sum((free.T @ motion) ** 2) > 0.5:
            names.append(name)
    if not names:
        turn, shift = free[:3, 0], free[3:, 0]
        names.append(
            f"a motion of rotation ({turn[0]:.2f}, {turn[1]:.2f}, {turn[2]:.2f}) and translation "
            f"({shift[0]:.2f}, {shift[1]:.2f}, {shift[2]:.2f})"
        )
    return tuple(names)


def weakest_direction(found: Information, normal: Float) -> tuple[str, float] | None:
    """The motion that the surfaces fix least of those that they fix, in words, and its standard error in metres.

    A rotation's error is that at the typical distance of the points from the middle.

    Args:
        normal: (3,) mean normal of the surface, upwards.
    """
    if not found.observable.any():
        return None
    deviation = np.sqrt(np.diag(found.directions.T @ found.covariance @ found.directions))
    worst = int(np.argmax(np.where(found.observable, deviation, -1.0)))
    likeness = {
        name: abs(float(found.directions[:, worst] @ motion)) for name, motion in _named_motions(normal).items()
    }
    return max(likeness, key=lambda name: likeness[name]), float(deviation[worst])


def _named_motions(normal: Float) -> dict[str, Float]:
    """Unit motions (6,) by their names, for a surface with the mean ``normal``."""
    flat = float(np.hypot(normal[0], normal[1])) < _MIN_DIP_SINE
    strike = np.array([1.0, 0.0, 0.0]) if flat else np.array([-normal[1], normal[0], 0.0]) / np.hypot(*normal[:2])
    dip = np.cross(normal, strike)
    turns_and_shifts = {
        "sliding to the east" if flat else "sliding along the strike": (np.zeros(3), strike),
        "sliding to the north" if flat else "sliding up and down the slope": (np.zeros(3), dip),
        "moving along the surface's normal": (np.zeros(3), normal),
        "turning about the surface's normal": (normal, np.zeros(3)),
        "tilting about the strike": (strike, np.zeros(3)),
        "tilting about the line of dip": (dip, np.zeros(3)),
    }
    return {name: np.concatenate(motion) for name, motion in turns_and_shifts.items()}


def relief_sd(found: Information) -> float:
    """Distance along the normal that a motion within what is not fixed would give, metres, by the relief there.

    The curvature in such a direction is not surely different from zero, but it is the best guess. With it the residuals
    say how far the motion can be; it is no more than ``unknown_motion``.
    """
    free = np.maximum(found.curvature, 0.0) * ~found.observable
    motion = np.einsum("ai,ab,bi->i", found.directions, found.covariance, found.directions)
    if found.likely is not None:
        motion = np.minimum(motion, found.likely**2)
    return float(np.sqrt(free @ motion))


def height_sd(covariance: Float, places: Float, normals: Float, radius: float) -> float:
    """Standard deviation of the surface's height at a fixed place, root mean square over the places, metres.

    A motion d of a surface with normal n changes its height at a fixed place by n.d / n_z, so that a slope that
    slides along itself keeps its height. Faces steeper than 80 degrees are left out.

    Args:
        covariance: (6, 6) of the motion vector, square metres.
        places, normals: (n, 3).
    """
    open_ground = np.abs(normals[:, 2]) > np.cos(np.radians(80))
    if not open_ground.any():
        open_ground[:] = True
    places, normals = places[open_ground], normals[open_ground]
    rise = np.hstack([np.cross(places, normals) / radius, normals]) / np.maximum(np.abs(normals[:, 2:]), 0.01)
    return float(np.sqrt(max(np.mean(np.einsum("ni,ij,nj->n", rise, covariance, rise)), 0.0)))
