"""Sentences for the user about the limits of a registration."""

from __future__ import annotations

import numpy as np

from ...interface.parameters import RegistrationParameters
from ..core.arrays import Float
from .measured import Measured, Solution
from .quality import STABLE_SCALES
from .rival_parts import caution

# Metres along the normal from which a shift of everything is more than two surveys' own positions explain: at 4 cm
# in height and 6.5 cm in plan an epoch, 95 % of pairs differ by less than 0.14 m along the normal of a 39 degree slope.
_MAX_NORMAL_SHIFT_M = 0.15
_MIN_OVERLAP_SHARE = 0.2
_MIN_STABLE_SHARE = 0.5  # share of stable ground below which most of a surface has moved
_MIN_SLID_SHARE = 0.01  # of the surface, above which the user hears of it
_MAX_PLANT_ERROR_M = 0.02  # metres of error caused by plants, above which the user is warned


def explain(
    found: Measured,
    parameters: RegistrationParameters,
    shift: Float,
    unobservable: tuple[str, ...],
    *,
    stable_given: bool,
) -> tuple[str, ...]:
    """Sentences about the limits of the registration.

    Args:
        shift: (3,) mean displacement of the moving cloud, metres.
        unobservable: motions that the surfaces do not fix, in words.
    """
    quality, sentences = found.quality, []
    along = float(shift @ quality.mean_normal)
    if parameters.method != "none" and not stable_given and abs(along) > _MAX_NORMAL_SHIFT_M:
        sentences.append(
            f"The later epoch was moved by {along:+.2f} m along the surface's normal, more than the usual error of "
            "surveys: check its datum and heights, or give an area known to be stable in case the whole slope has "
            "moved."
        )
    sentences.append(_about_stable_ground(found, parameters))
    alignment = found.solution.alignment
    if alignment is not None and alignment.slid > _MIN_SLID_SHARE:
        sentences.append(
            f"{alignment.slid:.0%} of the surface moved along itself against the rest and is left out of the "
            "registration."
        )
    if unobservable:
        there = (
            "what the icp method found there is chance" if parameters.method == "icp" else "there they stay as surveyed"
        )
        *others, last = unobservable
        listed = f"{', '.join(others)} or {last}" if others else last
        sentences.append(
            f"The surface does not fix the epochs' relative position against {listed}: {there}, and a movement of that "
            "kind cannot be seen."
        )
    if found.strain is not None:
        sentences.append(
            f"In plan the later survey is stretched by {-found.strain.largest:+.2%} against the earlier one (negative: "
            "shortened). One motion cannot remove that, so the errors cover it; check that both surveys use the same "
            "projection, units and scale."
        )
    sentences.append(_about_bending(found.solution))
    if not found.solution.converged:
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
    sentences.append(_about_plants(found))
    return tuple(sentence for sentence in sentences if sentence)


def _about_stable_ground(found: Measured, parameters: RegistrationParameters) -> str:
    """The sentence about what is taken as stable; empty where there is nothing to say."""
    quality, error, judged = found.quality, found.error, found.judged
    within = STABLE_SCALES * quality.scale
    if found.solution.left:
        return (
            f"No stable ground was found ({quality.stable_share:.0%} of the overlap agrees within "
            f"{within:.3f} m), so the epochs stay as surveyed; the registration error is widened to "
            f"{error:.3f} m; give an area known to be stable."
        )
    if judged is not None and (judged.contested or judged.by_position):
        return caution(judged, error)
    little = quality.stable_share < parameters.minimum_stable_share
    least = f"less than the least share of stable ground ({parameters.minimum_stable_share:.0%})"
    if judged is not None and (little or quality.stable_share < _MIN_STABLE_SHARE):
        return (
            f"Only {quality.stable_share:.0%} of the overlap agrees on one motion{f', {least}' if little else ''}: it "
            f"is taken as stable, because the next part that agrees holds {judged.part.rival:.0%}; give an area known "
            "to be stable if the rest of the surface cannot have moved."
        )
    if judged is None and little:
        return (
            f"Only {quality.stable_share:.0%} of the overlap agrees within {within:.3f} m, {least}; the registration "
            f"error is widened to {error:.3f} m; give an area known to be stable."
        )
    return ""


def _about_bending(solution: Solution) -> str:
    """The sentence about what one rigid motion leaves; empty where that is little."""
    bend = solution.bend
    if bend is not None and solution.bent:
        return (
            f"Heights were corrected by {np.ptp(bend.correction.heights):.3f} m from place to place, because stable "
            f"ground was bent by {bend.before:.3f} m after one rigid motion; a movement that changes so slowly over "
            "the slope is removed with it."
        )
    if bend is not None and bend.worth:
        return (
            f"Stable ground is bent by {bend.before:.3f} m after one rigid motion, as by strips that do not fit or by "
            f"a slow movement; --piecewise auto would leave {bend.after:.3f} m, and removes such movements too."
        )
    return ""


def _about_plants(found: Measured) -> str:
    """The sentence about the effect of plants; empty where there is none, or the clouds record none."""
    if found.ground is None:
        return ""
    if not found.bare and found.by_plants > _MAX_PLANT_ERROR_M:
        return (
            f"Too little ground is bare ({found.ground.bare_share:.0%}) to register by it alone, so what plants make "
            f"of the heights ({found.by_plants:.3f} m) is part of the registration error: a season that differs alike "
            "all over is taken for an offset of the survey; give bare ground, such as a road or rock, as stable where "
            "there is some."
        )
    offset = found.offset
    if found.bare and offset is not None and abs(offset) > max(_MAX_PLANT_ERROR_M, 2.0 * found.error):
        return (
            f"On bare ground the surveys agree, but the ground under plants lies {abs(offset):.3f} m "
            f"{'lower' if offset < 0 else 'higher'} in the later one at the median: another season, or a movement of "
            "all that is under plants."
        )
    return ""
