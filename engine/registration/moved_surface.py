"""Registration on the part of a surface that stayed, where much of it has moved."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ...interface.parameters import RegistrationParameters
from ..core.arrays import Float
from ..core.errors import InputError
from ..core.progress import Progress
from .alignment import Alignment
from .measured import Measured, measured, of_alignment
from .observability import height_sd
from .patch_agreement import PatchAgreement, patch_agreement
from .patch_registration import OnPatches, align_on_patches
from .point_to_plane import Matcher
from .quality import Agreement
from .rival_parts import difference, refusal
from .surface_patches import cut


_MIN_AGREEING_SHARE = 0.95  # of the patches, with which nothing of note moved: still surveys have 0.99
_MIN_STILL_SHARE = 0.9  # of a part: the registration by all ground contradicts it below
_MIN_CONTRADICTING_SHARE = 0.35  # of the patches: a smaller part may be chance on rough ground
_MIN_SHARE_OF_ALL_GROUND = 0.75  # of the patches, with which a registration by all ground is kept
_SIGNIFICANT = 12.6  # squared distance of two motions in units of their errors: 95 % of chi-square, six motions


def on_what_stayed(
    found: Measured,
    alignment: Alignment,
    matcher: Matcher,
    parameters: RegistrationParameters,
    progress: Progress,
) -> Measured:
    """``found``, or where much has moved the registration on the part that has not.

    Raises:
        InputError: hardly anything agrees and no part is clearly the one that stayed, unless that was accepted.
    """
    if found.bare and found.ground is not None:
        matcher = found.ground.bare
    alignment = found.solution.alignment or alignment
    patches = cut(matcher.moving, 3 * matcher.noise, matcher.firm)
    seen = patch_agreement(matcher, patches, alignment.pose)
    if not found.solution.left and seen.share >= _MIN_AGREEING_SHARE:
        return found
    on_patches = align_on_patches(matcher, patches, alignment, parameters, progress)
    if on_patches is None:
        return _without_a_part(found, seen, parameters)
    judged = on_patches.standing
    if judged.contested and not parameters.accept_unstable:
        raise InputError(refusal(judged))
    narrow = measured(of_alignment(on_patches.alignment), matcher, parameters, False, progress, patches=on_patches)
    if judged.contested:
        narrow = _covering(narrow, difference(judged, narrow.solution.radius))
    elif not found.solution.left and _keeps(alignment, seen, on_patches):
        return _covering_difference(found, alignment, on_patches.alignment)
    return replace(narrow, ground=found.ground, bare=found.bare, offset=found.offset, judged=judged)


def _without_a_part(found: Measured, seen: PatchAgreement, parameters: RegistrationParameters) -> Measured:
    share = min(found.quality.stable_share, seen.share)
    if (found.solution.left or share < parameters.minimum_stable_share) and not parameters.accept_unstable:
        raise InputError(
            f"Only {share:.0%} of the overlap agrees after registration and no part of the "
            "surface is clearly the one that did not move, so the epochs' relative position is not determined; give "
            "an area known to be stable (--stable), or --accept-unstable to go on with a wide error."
        )
    return found


def _keeps(alignment: Alignment, seen: PatchAgreement, on_patches: OnPatches) -> bool:
    """Whether the registration by all ground is kept, though a part of the patches is clearly stable.

    It is the more precise one where little moved. What the part fixes and all ground does not is not given away.
    """
    part = on_patches.part
    contradicted = part.share >= _MIN_CONTRADICTING_SHARE and seen.share_of(part.agrees) < _MIN_STILL_SHARE
    fixed = np.count_nonzero(alignment.information.observable)
    more = np.count_nonzero(on_patches.alignment.information.observable) > fixed
    return seen.share >= _MIN_SHARE_OF_ALL_GROUND and not contradicted and not more


def _covering_difference(found: Measured, alignment: Alignment, on_part: Alignment) -> Measured:
    """``found``, and where the part asks for another motion than both errors explain an error that covers both."""
    away = on_part.pose.vector(alignment.radius) - alignment.pose.vector(alignment.radius)
    spread = alignment.information.covariance + on_part.information.covariance
    if float(away @ np.linalg.solve(spread, away)) < _SIGNIFICANT:
        return found
    return _covering(found, away)


def _covering(found: Measured, away: Float) -> Measured:
    """``found`` with errors that cover a motion ``away`` (6,) from it, which may be the right one."""
    solution = found.solution
    assert solution.information is not None
    covariance = solution.information.covariance + np.outer(away, away)
    error = float(np.hypot(found.error, height_sd(np.outer(away, away), *_upward(found.quality), solution.radius)))
    return replace(
        found, solution=replace(solution, information=replace(solution.information, covariance=covariance)), error=error
    )


def _upward(quality: Agreement) -> tuple[Float, Float]:
    """Places and normals (n, 3) of the stable ground; of the mean where there is none."""
    if len(quality.places):
        return quality.places, quality.normals
    return quality.sample, np.broadcast_to(quality.mean_normal, quality.sample.shape)
