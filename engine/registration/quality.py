"""How well two registered surfaces agree on stable ground, and which warnings follow from it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ...interface.parameters import RegistrationParameters
from ..core.arrays import Float
from ..core.errors import InputError
from ..geometry.height_correction import HeightCorrection
from ..geometry.pose import Pose
from ..geometry.voxels import block_numbers
from ..statistics.robust import nmad
from .bending import Bend
from .point_to_plane import Matcher, Pairs, robust_scale
from .restarts import own_noise
from .rival_parts import Standing, caution

_SOURCES = 60_000
_STABLE_SCALES = 3.0  # scales within which a residual is noise
_MIN_PAIRS = 20
_MIN_BLOCKS, _MIN_BLOCK_PAIRS = 8, 20
# Metres along the normal from which a shift of everything is more than two surveys' own positions explain: at 4 cm
# in height and 6.5 cm in plan an epoch, 95 % of pairs differ by less than 0.14 m along the normal of a 39 degree slope.
_UNIFORM = 0.15
_MAX_NOISE_RATIO = 3.0  # times the surfaces' own noise: what differs more is no noise, however much of the ground it is
NO_STABLE_GROUND = 0.15  # share below which there is nothing to register by
_MIN_OVERLAP_SHARE = 0.2
_MIN_STABLE_SHARE = 0.5  # share of stable ground below which most of a surface has moved
_MAX_PLANT_ERROR_M = 0.02  # metres of error caused by plants, above which the user is warned


@dataclass(frozen=True)
class Agreement:
    """Point-to-plane residuals, moving minus reference, on ground that did not change. Lengths are metres.

    Attributes:
        scale: noise of a residual after registration.
        stable_share: share of the overlap within three scales.
        overlap_share: share of the moving points that have a counterpart.
        nmad_before, nmad_after, rms_before, rms_after: of the stable points' residuals.
        misfit: spread over the surface of the stable ground's residual, noise taken out: what a rigid motion leaves.
        misfit_height: the same as a height.
        mean_normal: (3,) mean upward normal of the stable ground.
        places, normals: (k, 3) of a sample of the stable ground, local coordinates before registration.
        spread: of all height differences about zero, changed ground included.
        sample: (n, 3) places of the compared points after registration, local coordinates.
        agrees: (n,) which of them are stable ground.
    """

    scale: float
    stable_share: float
    overlap_share: float
    nmad_before: float
    nmad_after: float
    rms_before: float
    rms_after: float
    misfit: float
    misfit_height: float
    mean_normal: Float
    places: Float
    normals: Float
    spread: float
    sample: Float
    agrees: NDArray[np.bool_]


def agreement(
    matcher: Matcher,
    pose: Pose,
    offset: float,
    correction: HeightCorrection | None = None,
    among: NDArray[np.bool_] | None = None,
) -> Agreement:
    """Measure how well the surfaces agree at ``pose``; ``offset`` (m) is how far apart they may be.

    Args:
        correction: of the moving surface's heights at ``pose``, in local coordinates.
        among: (m,) the moving surface's points that may be stable ground; all without it.

    Raises:
        InputError: hardly any point has a counterpart.
    """
    spacing = max(matcher.reference.spacing, matcher.moving.spacing)
    reach = max(offset, 3 * spacing)
    sources = matcher.moving.sample(_SOURCES)
    pairs = matcher.onto_reference(pose, matcher.moving.sample(_SOURCES, matcher.firm), reach, 0.5)
    if len(pairs) < _MIN_PAIRS:
        raise InputError(
            f"Only {len(pairs)} points of the later epoch have a counterpart within {reach:g} m on the earlier one, "
            "so the epochs do not overlap or hold no surface; check the files, their ground and the largest offset."
        )
    distance = matcher.distance(pose, sources, reach)
    if correction is not None:
        pairs = replace(pairs, residual=pairs.residual + pairs.normal[:, 2] * correction.at(pairs.place[:, :2]))
    noise = max(own_noise(matcher.reference), own_noise(matcher.moving))
    # where hardly anything is stable the core of the residuals is change
    may = np.ones(len(pairs), dtype=bool) if among is None else among[pairs.source]
    scale = max(min(robust_scale(pairs.residual[may]), _MAX_NOISE_RATIO * noise), 1e-4)
    stable = may & (np.abs(pairs.residual) <= _STABLE_SCALES * scale)
    before = matcher.onto_reference(Pose.identity(), pairs.source[stable], reach, 0.5).residual
    after = pairs.residual[stable]
    normals = pairs.normal[stable] * np.where(pairs.normal[stable][:, 2:] < 0, -1.0, 1.0)
    mean = normals.mean(axis=0) if len(normals) else np.array([0.0, 0.0, 1.0])
    misfit = _misfit(pairs, stable, 20 * spacing)
    steep = np.abs(normals[:, 2]) < 0.2
    cosine = np.median(np.abs(normals[~steep][:, 2])) if (~steep).any() else 0.2
    return Agreement(
        scale=scale,
        stable_share=float(stable.mean()),
        overlap_share=float(np.isfinite(distance).mean()),
        nmad_before=_nmad(before),
        nmad_after=_nmad(after),
        rms_before=_rms(before),
        rms_after=_rms(after),
        misfit=misfit,
        misfit_height=misfit / float(cosine),
        mean_normal=mean / np.linalg.norm(mean),
        places=matcher.moving.points[pairs.source[stable]][:: max(1, len(after) // 5000)],
        normals=normals[:: max(1, len(after) // 5000)],
        spread=nmad(pairs.residual, 0.0) / float(cosine),
        sample=pairs.place,
        agrees=stable,
    )


def widened(error: float, quality: Agreement, least_share: float) -> float:
    """The standard error of a height (m) where less than ``least_share`` of the ground is stable.

    The less there is of it, the less certain it is that it did not move: the error then approaches the spread of
    all height differences.
    """
    if quality.stable_share >= least_share:
        return error
    share = max(quality.stable_share, 0.02) / least_share
    return float(np.hypot(error / share, (1.0 - share) * quality.spread))


def explain(
    quality: Agreement,
    parameters: RegistrationParameters,
    *,
    converged: bool,
    shift: Float,
    error: float,
    unobservable: tuple[str, ...],
    stable_given: bool,
    left: bool = False,
    judged: Standing | None = None,
    bend: Bend | None = None,
    bent: bool = False,
) -> tuple[str, ...]:
    """Sentences about the limits of the registration.

    Args:
        shift: (3,) mean displacement of the moving cloud, metres.
        error: standard error of a height, metres.
        left: the epochs were left as surveyed because no stable ground was found.
        judged: the part that was registered alone and the largest other one.
        bend: what one rigid motion leaves.
        bent: it was removed.
    """
    sentences = []
    along = float(shift @ quality.mean_normal)
    if parameters.method != "none" and not stable_given and abs(along) > _UNIFORM:
        sentences.append(
            f"The later epoch was moved by {along:+.2f} m along the surface's normal, more than surveys usually err: "
            "check its datum and heights, or give an area known to be stable in case the whole slope has moved."
        )
    sentences.append(_about_stable_ground(quality, parameters, error, left=left, judged=judged))
    if unobservable:
        there = (
            "what the icp method found there is chance" if parameters.method == "icp" else "there they stay as surveyed"
        )
        sentences.append(
            f"The surface does not fix the epochs' relative position against {_listed(unobservable)}: {there}, and a "
            "movement of that kind cannot be seen."
        )
    sentences.append(_about_bending(bend, bent=bent))
    if not converged:
        sentences.append(
            "The registration did not settle within its iterations; check the result or raise their number."
        )
    if parameters.method == "robust" and float(np.linalg.norm(shift)) > parameters.maximum_offset:
        sentences.append(
            f"The offset found ({np.linalg.norm(shift):.2f} m) exceeds the largest expected one "
            f"({parameters.maximum_offset:g} m); raise maximum_offset and compare."
        )
    if quality.overlap_share < _MIN_OVERLAP_SHARE:
        sentences.append(
            f"Only {quality.overlap_share:.0%} of the later epoch's points have a counterpart on the earlier one; "
            "check that both cover the slope."
        )
    return tuple(sentence for sentence in sentences if sentence)


def _about_stable_ground(
    quality: Agreement, parameters: RegistrationParameters, error: float, *, left: bool, judged: Standing | None
) -> str:
    """The sentence about what is taken as stable; empty where there is nothing to say."""
    within = _STABLE_SCALES * quality.scale
    if left:
        return (
            f"No stable ground was found ({quality.stable_share:.0%} of the overlap agrees within "
            f"{within:.3f} m), so the epochs stay as surveyed; the registration error is widened to "
            f"{error:.3f} m; give an area known to be stable."
        )
    if judged is not None and (judged.contested or judged.by_position):
        return caution(judged, error)
    if judged is not None and quality.stable_share < max(parameters.minimum_stable_share, _MIN_STABLE_SHARE):
        little = quality.stable_share < parameters.minimum_stable_share
        than = f", less than the least share of stable ground ({parameters.minimum_stable_share:.0%})" if little else ""
        return (
            f"Only {quality.stable_share:.0%} of the overlap agrees on one motion{than}: it is taken as stable, "
            f"because the next part that agrees holds {judged.part.rival:.0%}; give an area known to be stable if the "
            "rest of the surface cannot have moved."
        )
    if judged is None and quality.stable_share < parameters.minimum_stable_share:
        return (
            f"Only {quality.stable_share:.0%} of the overlap agrees within {within:.3f} m, less than "
            f"the least share of stable ground ({parameters.minimum_stable_share:.0%}); the registration error is "
            f"widened to {error:.3f} m; give an area known to be stable."
        )
    return ""


def _about_bending(bend: Bend | None, *, bent: bool) -> str:
    """The sentence about what one rigid motion leaves; empty where that is little."""
    if bend is not None and bent:
        return (
            f"Heights were corrected by {np.ptp(bend.correction.heights):.3f} m from place to place, because stable "
            f"ground was bent by {bend.before:.3f} m after one rigid motion; a movement that changes so slowly over "
            "the slope is taken off with it."
        )
    if bend is not None and bend.worth:
        return (
            f"Stable ground is bent by {bend.before:.3f} m after one rigid motion, as by strips that do not fit or by "
            f"a slow movement; --piecewise auto would leave {bend.after:.3f} m, and takes such movements off too."
        )
    return ""


def explain_plants(
    *, error_by_plants: float, error: float, bare: bool, bare_share: float | None, offset: float | None
) -> tuple[str, ...]:
    """Sentences about the effect of plants on the registration; lengths in metres.

    Args:
        bare: bare ground alone was registered, the share ``bare_share``; None: nothing is known of plants.
        offset: height of the later survey's ground under plants over the earlier one's after that.
    """
    if bare_share is None:
        return ()
    if not bare and error_by_plants > _MAX_PLANT_ERROR_M:
        sentence = (
            f"Too little ground is bare ({bare_share:.0%}) to register by it alone, so what plants make of the heights "
            f"({error_by_plants:.3f} m) is part of the registration error: a season that differs alike all over is "
            "taken for an offset of the survey; give bare ground, such as a road or rock, as stable where there is "
            "some."
        )
        return (sentence,)
    if bare and offset is not None and abs(offset) > max(_MAX_PLANT_ERROR_M, 2.0 * error):
        sentence = (
            f"On bare ground the surveys agree, but the ground under plants lies {abs(offset):.3f} m "
            f"{'lower' if offset < 0 else 'higher'} in the later one at the median: another season, or a movement of "
            "all that is under plants."
        )
        return (sentence,)
    return ()


def _misfit(pairs: Pairs, stable: NDArray[np.bool_], block: float) -> float:
    """Spread about zero of the blocks' mean residual, less what the noise of the means explains."""
    if not stable.any():
        return 0.0
    residual, number = pairs.residual[stable], block_numbers(pairs.place[stable], block)
    count = np.bincount(number)
    enough = count >= _MIN_BLOCK_PAIRS
    if np.count_nonzero(enough) < _MIN_BLOCKS:
        return 0.0
    mean = np.bincount(number, residual)[enough] / count[enough]
    noise = float(np.median(np.var(residual) / count[enough]))
    spread = nmad(mean, 0.0)
    return float(np.sqrt(max(spread**2 - noise, 0.0)))


def _nmad(values: Float) -> float:
    return nmad(values) if len(values) else 0.0


def _rms(values: Float) -> float:
    return float(np.sqrt(np.mean(values**2))) if len(values) else 0.0


def _listed(names: tuple[str, ...]) -> str:
    return names[0] if len(names) == 1 else ", ".join(names[:-1]) + " or " + names[-1]
