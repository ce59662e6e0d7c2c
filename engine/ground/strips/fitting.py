"""The ground of one survey with its flight strips fitted to one another."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from ....interface.parameters import InputParameters
from ...core import cancellation
from ...core.messages import shown
from ...core.progress import Progress
from ..result import GroundResult
from .correction import FittedStrips, copy_fitted, fit_strips, strips_sentence

Extract = Callable[[Path, InputParameters, Progress], GroundResult]
"""Ground of a cloud, always into the same files."""


def with_fitted_strips(
    extract: Extract, cloud: Path, inputs: InputParameters, fit: bool, progress: Progress
) -> GroundResult:
    """Extract the ground; where fitting the strips is worth it (see ``judgement``), again from the fitted survey.

    Of strips that lie higher than others the ground holds little, as it is the lowest layer: it has to be looked for
    again. Only strips of this survey are compared with one another: what changes between two surveys is in all strips
    of the later one, and cannot be taken for a strip that does not fit.

    Args:
        fit: without it, strips stay as surveyed.

    Raises:
        EngineError, InputError: as ``extract``; a cloud cannot be read or written.
    """
    if not fit:
        return extract(cloud, inputs, progress)
    with progress.stage(0.0, 0.9):
        found = extract(cloud, inputs, progress)
    began = time.monotonic()
    with progress.stage(0.9, 0.93):
        fitted = fit_strips(found.classified, progress)
    if fitted is None:
        return found
    if fitted.fit.model is not None:
        found = _again(extract, found, fitted, progress)
    sentence = strips_sentence(fitted.fit, shown(cloud))
    warnings = (*found.warnings, sentence) if sentence else found.warnings
    if sentence:
        progress.warning(sentence)
    seconds = {**found.seconds, "strips": round(time.monotonic() - began, 3)}
    return replace(found, strips=fitted.fit.facts(), warnings=warnings, seconds=seconds)


def _again(extract: Extract, found: GroundResult, fitted: FittedStrips, progress: Progress) -> GroundResult:
    """The ground of the clipped survey with fitted strips; what is told of the raw survey stays."""
    progress.update(0.93, "extracting the ground of fitted strips")
    kept = {path: path.read_bytes() for path in found.pipelines if path.stem.endswith("_clip")}
    with cancellation.temporary(found.clipped.with_name(f"{found.clipped.stem}_fitted.laz")) as moved:
        copy_fitted(found.clipped, moved, fitted)
        for path in (found.ground, found.clipped, found.classified):
            path.unlink()
        # Its warnings are those of the first time.
        second = extract(moved, InputParameters(), Progress())
    for path, text in kept.items():
        path.write_bytes(text)
    return replace(
        second,
        raw_points=found.raw_points,
        raw_area=found.raw_area,
        raw_density=found.raw_density,
        roi_points=found.roi_points,
        roi_area=found.roi_area,
        roi_density=found.roi_density,
        ground_ratio=second.ground_points / found.roi_points,
        outliers=found.outliers + second.outliers,
        warnings=found.warnings,
    )
