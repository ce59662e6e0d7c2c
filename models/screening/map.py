"""The picture of a screening: where the slope looks raised or lowered, over its top view."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from ...engine.core.progress import Progress
from ...engine.maps.heatmap import write_heatmap_png
from ...engine.maps.heatmap_image import Heatmap, Words, make_heatmap
from ...engine.maps.top_view import TopView
from ...interface.parameters import HeatmapParameters
from .labels import BACKGROUND, SUBSIDENCE
from .zones import Hazards

_MAX_PROBABILITY = 1.0  # a probability ends there
_MIN_PROBABILITY = 1.0 / 3.0  # the most probable of three classes has at least this
_WORDS = Words(
    title="Screening",
    legend="Probability of the class",
    low="subsidence",
    high="uplift",
    veil=("grey veil: screened,", "labelled background"),
    signed=False,
)


def hazard_picture(hazards: Hazards, view: TopView) -> Heatmap:
    """Cells labelled uplift in blue and subsidence in red, by their probability; other screened ones in a grey veil."""
    own = np.take_along_axis(hazards.probability, hazards.labels[np.newaxis].astype(np.int64), axis=0)[0]
    shown = hazards.labels != BACKGROUND
    signed = np.where(hazards.labels == SUBSIDENCE, -own, own)
    # hazards by zones may be improbable ones: the legend then has no least
    least = _MIN_PROBABILITY if (own[shown] >= _MIN_PROBABILITY).all() else np.nan
    level = np.full(hazards.grid.shape, least)
    picture = make_heatmap(signed, shown, level, hazards.grid, view, HeatmapParameters(), limit=_MAX_PROBABILITY)
    return replace(picture, words=replace(_WORDS, notes=_notes(hazards)))


def write_hazard_map(
    path: Path, hazards: Hazards, view: TopView, progress: Progress | None = None, *, name: str = "", note: str = ""
) -> None:
    """Write the picture as an annotated PNG; ``note`` is a sentence that is added below it.

    See ``write_heatmap_png`` for ``progress``.

    Raises:
        InputError: the folder is missing or not writable.
    """
    picture = hazard_picture(hazards, view)
    if note:
        picture = replace(picture, words=replace(picture.words, notes=f"{picture.words.notes} {note}"))
    write_heatmap_png(path, picture, zones=hazards.frame, name=name, progress=progress)


def _notes(hazards: Hazards) -> str:
    count = len(hazards.frame)
    zones = f"{count or 'No'} zone{'' if count == 1 else 's'} found"
    return (
        f"{zones}. Shapes of one survey that look like subsidence (red) or uplift (blue); to be checked on site. "
        "Ground without colour is not thereby stable."
    )
