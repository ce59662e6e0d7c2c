"""Registration on the part of a surface that stayed, where much of it has moved."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ...interface.parameters import RegistrationParameters
from ..core.arrays import Float
from ..core.errors import InputError
from ..core.progress import Progress
from .alignment import Alignment
from .block_errors import with_block_errors
from .measured import Measured, covering, measured, of_alignment
from .patch_agreement import PatchAgreement, patch_agreement
from .patch_registration import OnPatches, align_on_patches
from .point_to_plane import Matcher
from .quality import STABLE_SCALES
from .rival_parts import MAX_RIVAL_RATIO_BESIDE, Standing, difference, refusal
from .surface_patches import Patches, cut

_MIN_AGREEING_SHARE = 0.95  # of the patches, with which nothing of note moved: still surveys have 0.99
_MIN_JUDGED_SHARE = 0.1  # of the patches, below which single points say more: rough or sparse ground
_MIN_STILL_SHARE = 0.9  # of a part: the registration by all ground contradicts it below
_MIN_CONTRADICTING_SHARE = 0.35  # of the patches: a smaller part may be chance on rough ground
_MIN_MAJORITY_SHARE = 0.5  # of the patches, without which a registration by all ground is not kept
_MIN_SHARE_OF_ALL_GROUND = 0.75  # of the patches, with which it is kept though a part contradicts it
_MIN_SHARE_OF_STEP = 0.9  # of the surface, which two parts hold: a bend takes many motions
_SIGNIFICANT = 12.6  # squared distance of two motions in units of their errors: 95 % of chi-square, six motions


def on_what_stayed(
    found: Measured,
    alignment: Alignment,
    matcher: Matcher,
    parameters: RegistrationParameters,
    progress: Progress,
) -> Measured:
    """``found``, or where much has moved the registration on the part that has not; with errors by blocks.

    Raises:
        InputError: hardly anything agrees and no part is clearly the one that stayed, unless that was accepted.
    """
    if found.bare and found.ground is not None:
        matcher = found.ground.bare
    patches = cut(matcher.moving, 3 * matcher.noise, matcher.firm)
    chosen = _chosen(found, found.solution.alignment or alignment, matcher, patches, parameters, progress)
    return with_block_errors(chosen, matcher, patches)


def _chosen(
    found: Measured,
    alignment: Alignment,
    matcher: Matcher,
    patches: Patches,
    parameters: RegistrationParameters,
    progress: Progress,
) -> Measured:
    """``found``, or the registration on the part that stayed."""
    seen = patch_agreement(matcher, patches, alignment.pose)
    if not found.solution.left and _agrees(found, seen):
        return found
    on_patches = align_on_patches(matcher, patches, alignment, parameters, progress)
    if on_patches is None:
        return _without_a_part(found, seen, parameters)
    judged = on_patches.standing
    if judged.contested and _within_scatter(found, judged, on_patches.alignment.scale):
        if judged.rose or judged.part.rival > MAX_RIVAL_RATIO_BESIDE * judged.part.share:
            bend = found.solution.bend
            # the error of a bent survey covers what one motion leaves
            bent = bend is not None and bend.worth and not _is_step(judged)
            return found if bent else covering(found, _square(_farthest(alignment, judged)))
        judged = replace(judged, known=True, contested=False)  # scatter makes small parts
    if judged.contested and not parameters.accept_unstable:
        raise InputError(refusal(judged))
    _require_expected(judged, parameters)
    narrow = measured(of_alignment(on_patches.alignment), matcher, parameters, False, progress, patches=on_patches)
    if judged.contested:
        narrow = covering(narrow, _square(difference(judged, narrow.solution.radius)))
    elif not found.solution.left:
        kept = _kept(found, alignment, seen, on_patches)
        if kept is not None:
            return kept
    return replace(narrow, ground=found.ground, bare=found.bare, offset=found.offset, judged=judged)


def _agrees(found: Measured, seen: PatchAgreement) -> bool:
    """Whether so much of the surface agrees with a registration that nothing of note has moved."""
    if seen.judged < _MIN_JUDGED_SHARE:
        return found.quality.stable_share >= _MIN_SHARE_OF_ALL_GROUND
    return seen.share >= _MIN_AGREEING_SHARE


def _within_scatter(found: Measured, judged: Standing, own_scale: float) -> bool:
    """Whether two parts differ by no more than points of the registration by all ground do, as on a bent survey.

    A step scatters points by itself. It is compared with the noise of the part's points, ``own_scale`` (m).
    """
    if found.solution.left or found.quality.stable_share < _MIN_SHARE_OF_ALL_GROUND:
        return False
    bend = found.solution.bend
    scatter = found.quality.scale if bend is None else max(found.quality.scale, bend.before)
    return judged.apart <= STABLE_SCALES * (own_scale if _is_step(judged) else scatter)


def _is_step(judged: Standing) -> bool:
    """Whether two parts leave nothing aside: between them is a step, which is no bend."""
    return judged.part.share + judged.part.rival >= _MIN_SHARE_OF_STEP


def _farthest(alignment: Alignment, judged: Standing) -> Float:
    """(6,) the motion from an alignment to that of two parts which is farther off."""
    parts = [one for one in (judged.part, judged.part.other) if one is not None]
    away = [one.pose.vector(alignment.radius) - alignment.pose.vector(alignment.radius) for one in parts]
    return max(away, key=lambda motion: float(np.linalg.norm(motion)))


def _require_expected(judged: Standing, parameters: RegistrationParameters) -> None:
    """Raise InputError if a part that leaves much of the surface aside lies farther off than surveys are expected to.

    Such a part may have moved, and the surveys may differ by less.
    """
    beyond = judged.offset > parameters.maximum_offset and judged.part.share < _MIN_SHARE_OF_ALL_GROUND
    if beyond and not judged.contested and not parameters.accept_unstable:
        raise InputError(
            f"The largest part that agrees on one motion ({judged.part.share:.0%} of the surface) lies "
            f"{judged.offset:.2f} m from where it was surveyed, more than the largest expected offset "
            f"({parameters.maximum_offset:g} m), so that it may have moved; give an area known to be stable "
            "(--stable), or raise --maximum-offset if the surveys can differ by so much."
        )


def _without_a_part(found: Measured, seen: PatchAgreement, parameters: RegistrationParameters) -> Measured:
    share = found.quality.stable_share
    if seen.judged >= _MIN_JUDGED_SHARE:
        share = min(share, seen.share)
    if (found.solution.left or share < parameters.minimum_stable_share) and not parameters.accept_unstable:
        raise InputError(
            f"Only {share:.0%} of the overlap agrees after registration and no part of the "
            "surface is clearly the one that did not move, so the epochs' relative position is not determined; give "
            "an area known to be stable (--stable), or --accept-unstable to go on with a wide error."
        )
    return found


def _kept(found: Measured, alignment: Alignment, seen: PatchAgreement, on_patches: OnPatches) -> Measured | None:
    """``found`` by all ground if it is kept, though a part of the patches is clearly stable; else None.

    Two motions that differ by no more than their errors are one: the surer one is taken. Of others the one by all
    ground is kept where little moved, with an error that covers both.
    """
    part, narrow = on_patches.part, on_patches.alignment
    first, second = alignment.information, narrow.information
    fixes_more = int(first.observable.sum()) - int(second.observable.sum())
    still = seen.share_of(part.agrees)
    if fixes_more > 0 and seen.share >= part.share and still >= _MIN_STILL_SHARE:
        return found  # as much agrees with it
    if seen.share < _MIN_MAJORITY_SHARE or fixes_more < 0:
        return None
    away = narrow.pose.vector(alignment.radius) - alignment.pose.vector(alignment.radius)
    if float(away @ np.linalg.solve(first.covariance + second.covariance, away)) < _SIGNIFICANT:
        return found if np.trace(first.covariance) <= np.trace(second.covariance) else None
    contradicted = part.share >= _MIN_CONTRADICTING_SHARE and still < _MIN_STILL_SHARE
    return covering(found, _square(away)) if seen.share >= _MIN_SHARE_OF_ALL_GROUND and not contradicted else None


def _square(away: Float) -> Float:
    """(6, 6) covariance that covers a motion ``away`` (6,), which may be the right one."""
    return np.outer(away, away)
