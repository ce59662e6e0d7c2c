"""What metadata say of a hand-over: title, extent on the globe, days, lineage, who answers for it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import date
from pathlib import Path, PureWindowsPath
from typing import Any

import numpy as np
import rasterio
import shapely
from pyproj import CRS, Transformer
from pyproj.exceptions import ProjError

from ..core.errors import InputError
from ..core.messages import shown
from .held import Held

_WHAT = {
    "inspect": "Change of a slope between two surveys", "change": "Change of a slope between two surveys",
    "series": "Change of a slope over a series of surveys", "screen": "Places of a slope that look raised or lowered",
    "displacement": "Displacement of a slope along its surface", "batch": "Change of the slopes of a road corridor",
    "demchange": "Change of a slope between elevation models", "m3c2": "Change of a slope along its normals",
    "locate": "Places on the road", "planflight": "Plan of a survey's flight",
    "compareflight": "A survey's flight compared with its plan",
}  # fmt: skip
_EDGE_POINTS = 21
"""Along each side of the extent, whose edges are bent on the globe."""


@dataclass(frozen=True)
class Input:
    """A file that the run read: its role, its name without folders, its SHA-256."""

    role: str
    name: str
    sha256: str


@dataclass(frozen=True)
class About:
    """``bounds`` in the run's own system and ``globe`` in degrees: west, south, east, north."""

    identifier: str
    title: str
    abstract: str
    organisation: str
    email: str
    licence: str
    stamp: date
    days: tuple[date, ...]
    bounds: tuple[float, float, float, float]
    globe: tuple[float, float, float, float]
    crs: CRS
    cell_m: float | None
    level_m: float | None
    inputs: tuple[Input, ...]
    software: str
    command: str
    warnings: tuple[str, ...]

    @property
    def system(self) -> CRS:
        """The reference system of the places alone, without heights."""
        return self.crs.sub_crs_list[0] if self.crs.is_compound else self.crs

    @property
    def epsg(self) -> int | None:
        return self.system.to_epsg()


def describe(held: Held, title: str, organisation: str, email: str, licence: str, *, name: str = "") -> About:
    """What there is to say of ``held``; an empty ``title`` is made of ``name``, else its folder, and days.

    Raises:
        InputError: its results have no reference system or no place.
    """
    if held.crs is None:
        raise InputError(
            f"The results in {shown(held.folder)} have no reference system; make the run again with --crs."
        )
    bounds, cell = _bounds(held)
    what = _WHAT.get(str(held.record["command"]), "Results of SlopeWatch")
    span = " to ".join(dict.fromkeys(day.isoformat() for day in (*held.days[:1], *held.days[-1:])))
    run_id = str(held.record.get("run_id", ""))
    level = held.record.get("metrics", {}).get("lod_median_m")
    return About(
        identifier=run_id or f"slopewatch-{held.record['command']}",
        title=title or f"{name or held.folder.name}: {what}{f', {span}' if span else ''}",
        abstract=f"{what}{f', {span}' if span else ''}.{_zones_in_words(held)}",
        organisation=organisation,
        email=email,
        licence=licence,
        stamp=date.fromisoformat(str(held.record.get("started", "1970-01-01"))[:10]),
        days=held.days,
        bounds=bounds,
        globe=_on_the_globe(bounds, held.crs),
        crs=held.crs,
        cell_m=cell,
        level_m=float(level) if isinstance(level, (int, float)) and math.isfinite(level) else None,
        inputs=tuple(_input(one) for one in held.record.get("inputs", ())),
        software=str(held.record.get("software", "SlopeWatch")),
        command=str(held.record["command"]),
        warnings=tuple(held.record.get("warnings", ())),
    )


def _zones_in_words(held: Held) -> str:
    """Empty for runs that look for no zones, such as a plan."""
    if not held.zones:
        return ""
    found = sum(len(layer.frame) for layer in held.zones)
    return f" {found} zone(s). No change above the level of detection is no statement that nothing moved."


def _input(one: dict[str, Any]) -> Input:
    # without its folders, which belong to the machine; a record may come from Windows
    name = PureWindowsPath(Path(str(one.get("path", ""))).name).name
    return Input(str(one["role"]), name, str(one.get("sha256", "")))


def _bounds(held: Held) -> tuple[tuple[float, float, float, float], float | None]:
    """West, south, east, north of all results, and the cell (m) of the first raster."""
    found: list[Sequence[float]] = []
    cell = None
    for path in held.rasters.values():
        with rasterio.open(path) as source:
            found.append(tuple(source.bounds))
            cell = cell or float(source.transform.a)
    if not found:
        frames = [p for layer in held.layers if (p := layer.places) is not None and len(p)]
        found = [tuple(frame.total_bounds) for frame in frames]
    if not found:
        raise InputError(f"{shown(held.folder)} holds nothing with a place; give the folder of another run.")
    corners = np.array(found)
    west, south = corners[:, :2].min(axis=0).tolist()
    east, north = corners[:, 2:].max(axis=0).tolist()
    return (west, south, east, north), cell


def _on_the_globe(bounds: tuple[float, float, float, float], crs: CRS) -> tuple[float, float, float, float]:
    flat = crs.sub_crs_list[0] if crs.is_compound else crs
    try:
        moved = Transformer.from_crs(flat, "EPSG:4326", always_xy=True).transform_bounds(
            *bounds, densify_pts=_EDGE_POINTS
        )
    except ProjError as error:
        raise InputError(f"The results have no place on the globe ({error}); check their reference system.") from error
    west, south, east, north = (round(value, 7) for value in moved)
    if not all(map(math.isfinite, moved)):
        raise InputError("The results lie outside of where their reference system holds; check it.")
    return west, south, east, north


def footprint(about: About) -> shapely.Polygon:
    """The extent in degrees, counterclockwise."""
    return shapely.box(*about.globe, ccw=True)
