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
from .patch_registration import MIN_SHARE_WITHOUT_PATCHES, align_on_patches, keeps
from .point_to_plane import Matcher
from .quality import Agreement
from .rival_parts import Standing, difference, refusal


def on_what_stayed(
    found: Measured,
    alignment: Alignment | None,
    matcher: Matcher,
    parameters: RegistrationParameters,
    progress: Progress,
) -> Measured:
    """``found``, or where much has moved the registration on the part that has not.

    Raises:
        InputError: hardly anything agrees and no part is clearly the one that stayed, unless that was accepted.
    """
    if not found.solution.left and found.quality.stable_share >= MIN_SHARE_WITHOUT_PATCHES:
        return found
    if found.bare and found.ground is not None:
        matcher = found.ground.bare
    patches = align_on_patches(matcher, alignment, parameters, progress)
    if patches is not None:
        judged = patches.standing
        if judged.contested and not parameters.accept_unstable:
            raise InputError(refusal(judged))
        narrow = measured(of_alignment(patches.alignment), matcher, parameters, False, progress, patches=patches)
        if judged.contested:
            narrow = _covering_both(narrow, judged)
        elif not found.solution.left and keeps(found.quality.stable_share, narrow.quality.stable_share, patches):
            return found
        return replace(narrow, ground=found.ground, bare=found.bare, offset=found.offset, judged=judged)
    little = found.solution.left or found.quality.stable_share < parameters.minimum_stable_share
    if little and not parameters.accept_unstable:
        raise InputError(
            f"Only {found.quality.stable_share:.0%} of the overlap agrees after registration and no part of the "
            "surface is clearly the one that did not move, so the epochs' relative position is not determined; give "
            "an area known to be stable (--stable), or --accept-unstable to go on with a wide error."
        )
    return found


def _covering_both(found: Measured, judged: Standing) -> Measured:
    """``found`` with errors that cover the motion of the other part, which may be the one that stayed."""
    solution = found.solution
    assert solution.information is not None
    away = difference(judged, solution.radius)
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
