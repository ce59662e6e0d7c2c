"""Areas that people corrected: left out of the comparison, or with ground that is forced or forbidden."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import date
from itertools import combinations
from pathlib import Path
from typing import Any

import geopandas as gpd
import pandas as pd
import shapely
from pyproj import CRS
from shapely.geometry import MultiPolygon, Polygon
from shapely.geometry.base import BaseGeometry

from ...interface.corrections import ACTION, ACTIONS, EPOCH, GROUND, NOT_GROUND, REASON
from ..core.errors import InputError
from ..core.messages import quoted, shown
from ..crs.reprojection import reprojected
from .asset_classes import SLIVER_M
from .polygon_file import read_polygons

_FAR_M = 1e5
"""A slope ends nearer than that around its corrections."""


class OutsideError(InputError):
    """No correction of a file lies on the slope."""


@dataclass(frozen=True)
class Correction:
    """One polygon, metres of the clouds' reference system; ``day`` is the survey that it holds for, None for all."""

    action: str
    shape: MultiPolygon
    reason: str = ""
    day: date | None = None

    def holds_for(self, day: date | None) -> bool:
        return self.day is None or self.day == day


@dataclass(frozen=True)
class Corrections:
    """The corrections of one file, in its order."""

    path: Path
    areas: tuple[Correction, ...]

    def of(self, day: date | None) -> Corrections:
        """Those that hold for the survey of a day."""
        return Corrections(self.path, tuple(area for area in self.areas if area.holds_for(day)))

    def shape(self, action: str) -> BaseGeometry:
        """All polygons with an action in one; empty where there is none."""
        return shapely.union_all([area.shape for area in self.areas if area.action == action])

    def outside(self, area: BaseGeometry | None, *actions: str) -> BaseGeometry | None:
        """An area without the polygons of some actions; None is everywhere."""
        without = shapely.union_all([self.shape(action) for action in actions])
        if without.is_empty:
            return area
        return (without.envelope.buffer(_FAR_M) if area is None else area).difference(without)

    def facts(self) -> dict[str, Any]:
        """Number and area (m²) of the polygons by action, and one row for each polygon."""
        rows = [
            {
                "action": area.action,
                "reason": area.reason,
                "epoch": "" if area.day is None else area.day.isoformat(),
                "area_m2": float(area.shape.area),
            }
            for area in self.areas
        ]
        sums = {
            f"{action}_{name}": value
            for action in ACTIONS
            for name, value in (
                ("count", sum(row["action"] == action for row in rows)),
                ("area_m2", float(self.shape(action).area)),
            )
        }
        return {"file": self.path.name, **sums, "areas": rows}

    def within(self, slope: BaseGeometry) -> tuple[Corrections, str]:
        """Those that lie on the slope, and a sentence on those that do not; empty where all do.

        Raises:
            OutsideError: none does.
        """
        kept = tuple(area for area in self.areas if area.shape.intersects(slope))
        if not kept:
            raise OutsideError(
                f"No correction of {shown(self.path)} lies on the slope; check the reference system of the file."
            )
        outside = len(self.areas) - len(kept)
        if not outside:
            return self, ""
        sentence = f"{outside} of {len(self.areas)} corrections of {shown(self.path)} lie outside the slope: not used."
        return Corrections(self.path, kept), sentence

    def refuse_other_days(self, days: list[date | None]) -> None:
        """Raise InputError if a correction is of a day without a survey."""
        for number, area in enumerate(self.areas, 1):
            if area.day is not None and area.day not in days:
                known = ", ".join(sorted(day.isoformat() for day in days if day is not None)) or "none with a date"
                raise InputError(
                    f"Correction {number} of {shown(self.path)} has the {EPOCH} {area.day.isoformat()}, but the "
                    f"surveys are {known}; give the date of a survey, or leave the field empty for all surveys."
                )


def read_corrections(path: Path, crs: CRS, *, unit: float = 1.0) -> tuple[Corrections, tuple[str, ...]]:
    """The corrections of a polygon layer in metres of ``crs``, and sentences on what was assumed.

    The field ``action`` holds one of ``interface.corrections.ACTIONS``. The fields ``reason`` (text) and ``epoch`` (the
    date of a survey, empty for all) may be missing.

    Args:
        unit: metres of the clouds' own horizontal unit, in which polygons that declare no system are taken to be.

    Raises:
        InputError: it cannot be read or has no polygon or no such field, an action or a date is none, or ground is
            forced and forbidden in one place.
    """
    name, notes = shown(path), []
    frame, column = read_polygons(path, ACTION, "")
    shapes = frame.geometry.to_numpy()
    if frame.crs is None:
        notes.append(f"The corrections {name} declare no reference system; the surveys' ({crs.name}) is assumed.")
        shapes = shapely.transform(shapes, lambda xy: xy * unit)
    else:
        shapes = reprojected(list(shapes), frame.crs, crs, f"The layer of corrections {name}", notes)
    columns = {str(one).lower(): one for one in frame.columns}
    areas = []
    for number, shape in enumerate(shapes, 1):
        polygons = [p for p in shapely.get_parts(shapely.get_parts(shape)) if isinstance(p, Polygon)] if shape else []
        if not polygons:
            continue
        place = f"Correction {number} of {name}"
        row = frame.iloc[number - 1]
        areas.append(
            Correction(
                _action(row[column], place),
                MultiPolygon(polygons) if len(polygons) > 1 else MultiPolygon([polygons[0]]),
                _text(row, columns.get(REASON)),
                _day(row, columns.get(EPOCH), place),
            )
        )
    if not areas:
        raise InputError(f"The corrections {name} hold no polygon; draw one around each area to correct.")
    _refuse_contradictions(areas, name)
    return Corrections(Path(path), tuple(areas)), tuple(notes)


def _text(row: gpd.GeoSeries, column: str | None) -> str:
    value = None if column is None else row[column]
    return "" if value is None or pd.isna(value) else str(value).strip()


def _action(value: Any, place: str) -> str:
    action = "" if pd.isna(value) else str(value).strip().lower()
    if action not in ACTIONS:
        raise InputError(f"{place} has the {ACTION} {quoted(action)}; give {', '.join(ACTIONS[:-1])} or {ACTIONS[-1]}.")
    return action


def _day(row: gpd.GeoSeries, column: str | None, place: str) -> date | None:
    text = _text(row, column)
    if not text:
        return None
    try:
        return date.fromisoformat(text[:10])  # a date that was read as a time of day ends with 00:00:00
    except ValueError:
        raise InputError(
            f"{place} has the {EPOCH} {quoted(text)}; give the date of a survey as YYYY-MM-DD, or leave it empty."
        ) from None


def _refuse_contradictions(areas: list[Correction], name: str) -> None:
    """Raise InputError where ground is both forced and forbidden on more than a sliver."""
    for (i, one), (j, other) in combinations(enumerate(areas, 1), 2):
        alike = one.day is None or other.holds_for(one.day) or other.day is None
        if {one.action, other.action} != {GROUND, NOT_GROUND} or not alike:
            continue
        common = shapely.intersection(one.shape, other.shape)
        if common.buffer(-SLIVER_M / 2).is_empty:
            continue
        place = common.representative_point()
        raise InputError(
            f"The corrections {i} ({one.action}) and {j} ({other.action}) of {name} contradict each other on "
            f"{common.area:.1f} m², as at x {place.x:.1f}, y {place.y:.1f}; cut one out of the other."
        )
