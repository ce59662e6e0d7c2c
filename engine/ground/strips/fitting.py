"""The ground of one survey with its flight strips fitted to one another."""

from __future__ import annotations

import time
from dataclasses import replace

from ....interface.parameters import GroundParameters
from ...core.messages import shown
from ...core.progress import Progress
from ..result import GroundResult
from .correction import correct_strips, fit_strips, strips_sentence


def with_fitted_strips(found: GroundResult, parameters: GroundParameters, progress: Progress) -> GroundResult:
    """Compare the strips of the ground that was found and correct its file where that is worth it, see ``judgement``.

    Only strips of this survey are compared with one another: what changes between two surveys is in all strips of the
    later one, and cannot be taken for a strip that does not fit.

    Raises:
        EngineError, InputError: the ground cannot be read or written.
    """
    if parameters.strips == "off":
        return found
    began = time.monotonic()
    fitted = fit_strips(found.ground, progress)
    if fitted is None:
        return found
    if fitted.fit.model is not None:
        correct_strips(found.ground, fitted)
    warnings = found.warnings
    sentence = strips_sentence(fitted.fit, shown(found.ground))
    if sentence:
        progress.warning(sentence)
        warnings = (*warnings, sentence)
    seconds = {**found.seconds, "strips": round(time.monotonic() - began, 3)}
    return replace(found, strips=fitted.fit.facts(), warnings=warnings, seconds=seconds)
