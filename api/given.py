"""What a caller in Python gives, as the workflows take it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from datetime import date
from pathlib import Path
from typing import Any

from ..engine.epochs.epoch import Epoch, parse_date
from ..interface.dates import date_in_name
from ..workflows.layer_files import LayerFiles

PathLike = str | Path


def paths(**paths: PathLike | None) -> dict[str, Any]:
    return {name: None if path is None else Path(path) for name, path in paths.items()}


def layers(
    centreline: PathLike | None,
    field_names: PathLike | None,
    classes: PathLike | None = None,
    corrections: PathLike | None = None,
) -> LayerFiles:
    files = paths(centreline=centreline, field_names=field_names, classes=classes, corrections=corrections)
    return LayerFiles(**files)


def epochs(surveys: Mapping[str | date, PathLike] | Sequence[PathLike]) -> list[Epoch]:
    """Surveys with their days: the keys of a mapping, or for a sequence the dates in the file names."""
    if isinstance(surveys, Mapping):
        return [Epoch(Path(p), d if isinstance(d, date) else parse_date(d)) for d, p in surveys.items()]
    return [Epoch(Path(p), date_in_name(Path(p))) for p in surveys]


def day(given: str | date | None) -> str | None:
    return given.isoformat() if isinstance(given, date) else given
