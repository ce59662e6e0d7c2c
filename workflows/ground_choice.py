"""Which points of raw surveys are their ground: what is given, checked and offered before any work."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from ..engine.core.errors import InputError
from ..engine.core.messages import shown
from ..engine.core.progress import Progress
from ..engine.epochs.epoch import Epoch
from ..engine.ground.given_ground import has_class_2
from .settings import SeriesSettings


def check_ground(epochs: Sequence[Epoch], ground: str, progress: Progress) -> None:
    """Refuse class 2 of surveys that lack it; offer it where the ground is to be extracted and all surveys have it.

    Args:
        ground: as of ``RawGroundParameters``.

    Raises:
        InputError: a survey has no points of class 2; a cloud is damaged.
    """
    if ground == "extract" and all(has_class_2(epoch.path, every=False) for epoch in epochs):
        progress.info("The surveys have points of class 2; set ground to class_2 to take these as the ground.")
    if ground != "class_2":
        return
    having = [has_class_2(epoch.path) for epoch in epochs]
    if all(having):
        return
    without = shown(epochs[having.index(False)].path)
    if any(having):
        other = shown(epochs[having.index(True)].path)
        raise InputError(
            f"{without} has no points of class 2 but {other} has; set ground to extract, so that all are found alike."
        )
    raise InputError(f"{without} has no points of class 2; set ground to extract.")


def with_one_ground(settings: SeriesSettings) -> SeriesSettings:
    """The settings with ``ground`` and ``ground_ready``, the older name of as_is, saying the same.

    Raises:
        InputError: they contradict each other.
    """
    ground, series = settings.ground, settings.series
    if series.ground_ready and ground.ground == "class_2":
        raise InputError("ground_ready takes all points as the ground, class_2 only some; leave out ground_ready.")
    if not series.ground_ready and ground.ground != "as_is":
        return settings
    return replace(settings, ground=replace(ground, ground="as_is"), series=replace(series, ground_ready=True))
