"""Sections through a zone: heights of two surveys and the change along a line, with the level of detection."""

from __future__ import annotations

import csv
import math
from dataclasses import dataclass
from pathlib import Path

TABLE = "profiles.csv"
_NAN = math.nan


@dataclass(frozen=True)
class Place:
    """A cell that a line passes: metres along the line, heights, change and level of detection; NaN where unknown."""

    distance: float
    height_from: float
    height_to: float
    change: float
    level: float


@dataclass(frozen=True)
class SectionVector:
    """Motion of the ground near a line, metres: where along it, by how much in its direction, and how much upwards."""

    distance: float
    along: float
    up: float


@dataclass(frozen=True)
class Section:
    """The cells along a line, in its order. ``name`` says which line it is; ``vectors`` are the motions near it."""

    name: str
    places: tuple[Place, ...]
    vectors: tuple[SectionVector, ...] = ()

    @property
    def has_heights(self) -> bool:
        """Whether the heights of a survey are known anywhere."""
        return any(math.isfinite(p.height_from) or math.isfinite(p.height_to) for p in self.places)


def sections_of(folder: Path, zone: str) -> list[Section]:
    """The profiles of a run through a zone, from the run's own table; none where it has none.

    Raises:
        ValueError: the table is not that of a run.
        OSError: it cannot be read.
    """
    path = folder / TABLE
    if not path.is_file():
        return []
    found: dict[str, list[Place]] = {}
    with path.open(encoding="utf-8", newline="") as file:
        for row in csv.DictReader(file):
            try:
                if row["zone_id"] == zone:
                    found.setdefault(row["profile"], []).append(_place(row))
            except KeyError as error:
                raise ValueError(f"{path} has no column {error}; make the report again.") from None
    return [Section(name, tuple(places)) for name, places in found.items()]


def _place(row: dict[str, str]) -> Place:
    names = ("distance_m", "height_from_m", "height_to_m", "dz_m", "level_m")
    return Place(*(float(row[name]) if row[name] else _NAN for name in names))
