"""The coordinate reference system a cloud declares, and its metre version, in which everything is computed."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import shapely
from pyproj import CRS, Proj, Transformer
from pyproj.crs import CompoundCRS
from pyproj.exceptions import CRSError, ProjError

from ...interface.parameters import InputParameters
from ..core.errors import InputError
from ..core.messages import shown

_UNITS = {"metre": 1.0, "foot": 0.3048, "us-survey-foot": 1200 / 3937}
_UNIT_NAMES = {"metre": "metres", "foot": "international feet", "us-survey-foot": "US survey feet"}
_MAX_DISTORTION = 0.01
_MARGIN_DEG = 3.0  # degrees: surveys near the border of a zone are flown in either
_NO_LENGTHS = ("degree", "grad", "radian", "unity")


@dataclass(frozen=True)
class WorkingFrame:
    """The reference system in which everything is computed, and how to get there from the file's coordinates.

    ``crs`` has metre axes. x and y of the file times ``horizontal_factor`` and z times ``vertical_factor`` are metres
    in it. ``notes`` are sentences about what was converted or overridden.
    """

    crs: CRS
    horizontal_factor: float
    vertical_factor: float
    notes: tuple[str, ...]

    @property
    def factors(self) -> tuple[float, float, float]:
        """Metres of one unit of the file in x, y and z."""
        return self.horizontal_factor, self.horizontal_factor, self.vertical_factor

    @property
    def in_metres(self) -> bool:
        """Whether the file's coordinates are metres already."""
        return self.horizontal_factor == 1.0 and self.vertical_factor == 1.0


def working_frame(declared: CRS | None, inputs: InputParameters, path: Path | str) -> WorkingFrame:
    """The metre frame of a cloud.

    Args:
        declared: what the file declares, see ``declared_crs``.
        inputs: ``crs`` overrides what is declared (declared heights stay where it has none), ``height_unit`` the
            unit of z.
        path: the cloud, for messages.

    Raises:
        InputError: no reference system, one in degrees, a geocentric one, or one that is unknown.
    """
    name = shown(path)
    notes: list[str] = []
    crs = declared
    if inputs.crs:
        crs = given_crs(inputs.crs)
        if declared is not None and not _same(declared, crs):
            notes.append(f"{name} declares the reference system {declared.name}; the given {crs.name} is used instead.")
        if declared is not None and declared.is_compound and crs.is_projected and len(crs.axis_info) == 2:
            heights = declared.sub_crs_list[-1]
            crs = CompoundCRS(f"{crs.name} + {heights.name}", [crs, heights])
            notes.append(f"{name} keeps the heights that it declares, {heights.name}.")
    if crs is None:
        raise InputError(f"{name} declares no coordinate reference system; give a projected one with --crs EPSG:n.")
    kind = "the given reference system" if inputs.crs else f"{name} declares the reference system"
    parts = _parts(crs, kind)
    axes = [axis for part in parts for axis in part.axis_info]
    vertical_axis = axes[2] if len(axes) > 2 else None
    horizontal_factor = _factor(axes[0])
    vertical_factor = _factor(vertical_axis or axes[0])
    if vertical_axis is not None and vertical_axis.direction == "down":
        raise InputError(f"{kind} {crs.name}, whose heights count downwards; give one with heights by --crs EPSG:n.")
    if inputs.height_unit != "auto":
        given = _UNITS[inputs.height_unit]
        if vertical_axis is not None and not math.isclose(given, vertical_factor, rel_tol=1e-9):
            notes.append(
                f"{name} is read with heights in {_UNIT_NAMES[inputs.height_unit]} as given, against its reference "
                "system."
            )
        vertical_factor = given
    for factor, what in ((horizontal_factor, "Coordinates"), (vertical_factor, "Heights")):
        if not 1e-3 <= factor <= 1e4:
            raise InputError(
                f"{kind} {crs.name}, whose unit is {factor:g} m; give one in metres or feet by --crs EPSG:n."
            )
        if factor != 1.0:
            notes.append(f"{what} of {name} are converted from {_unit_name(factor)} to metres (times {factor:.12g}).")
    return WorkingFrame(_in_metres(crs, parts), horizontal_factor, vertical_factor, tuple(notes))


def given_crs(text: str) -> CRS:
    """The reference system of an option's text, such as ``EPSG:32651``.

    Raises:
        InputError: unknown.
    """
    try:
        return CRS.from_user_input(text)
    except CRSError as error:
        raise InputError(
            f"crs is {text!r}, which is unknown; give a projected reference system such as EPSG:32651."
        ) from error


def plausibility(frame: WorkingFrame, x: float, y: float) -> list[str]:
    """Warnings where the reference system cannot well be that of a cloud around ``x``, ``y`` (metres in it)."""
    crs = frame.crs.sub_crs_list[0] if frame.crs.is_compound else frame.crs
    base = crs.geodetic_crs
    if base is None:  # a local grid
        return []
    try:
        longitude, latitude = Transformer.from_crs(crs, base, always_xy=True).transform(x, y, errcheck=True)
        factors = Proj(crs).get_factors(longitude, latitude, errcheck=True)
    except (CRSError, ProjError):
        return [f"The reference system {crs.name} does not reach x {x:.0f}, y {y:.0f}; check it."]
    warnings = []
    area = crs.area_of_use
    if area is not None and not shapely.box(*area.bounds).buffer(_MARGIN_DEG).contains(
        shapely.Point(longitude, latitude)
    ):
        warnings.append(
            f"The cloud lies at longitude {longitude:.2f}, latitude {latitude:.2f} by the reference system {crs.name}, "
            "outside of its area of use; check the reference system."
        )
    if abs(factors.areal_scale - 1.0) > _MAX_DISTORTION:
        warnings.append(
            f"Areas in the reference system {crs.name} are {factors.areal_scale:.3g} times those on the ground here; "
            "reproject the clouds to a local one for true areas and volumes."
        )
    return warnings


def _parts(crs: CRS, kind: str) -> list[CRS]:
    """The horizontal (or three-dimensional) part and the vertical one, if any; refuses what has no plane."""
    whole = _unbound(crs)
    parts = [_unbound(part) for part in whole.sub_crs_list] or [whole]
    what = parts[0].type_name
    if parts[0].is_geographic:
        raise InputError(
            f"{kind} {crs.name}, which is geographic (degrees); reproject the cloud to a projected one or, if the "
            "declaration is wrong, give the right one with --crs EPSG:n."
        )
    if what.startswith(("Geocentric", "Geodetic")):
        raise InputError(
            f"{kind} {crs.name}, which is geocentric; reproject the cloud to a projected one or, if the declaration is "
            "wrong, give the right one with --crs EPSG:n."
        )
    if not (parts[0].is_projected or "Projected" in what or "Engineering" in what):
        raise InputError(f"{kind} {crs.name}, which has no plane coordinates; give a projected one with --crs EPSG:n.")
    return parts


def _unbound(crs: CRS) -> CRS:
    return CRS(crs.source_crs) if crs.is_bound else crs


def _factor(axis: Any) -> float:
    """Metres of one unit of one of pyproj's axes."""
    return math.nan if axis.unit_name in _NO_LENGTHS else float(axis.unit_conversion_factor)


def _unit_name(factor: float) -> str:
    for key, value in _UNITS.items():
        # International and US survey feet differ by 2e-6.
        if math.isclose(factor, value, rel_tol=1e-7):
            return _UNIT_NAMES[key]
    return f"units of {factor:.12g} m"


def _in_metres(crs: CRS, parts: list[CRS]) -> CRS:
    """The same projection and heights with metre axes; the reference system itself where it has them already."""
    converted = [_part_in_metres(part) for part in parts]
    if all(new is old for new, old in zip(converted, parts, strict=True)):
        return crs
    return converted[0] if len(parts) == 1 else CompoundCRS(" + ".join(part.name for part in converted), converted)


def _part_in_metres(part: CRS) -> CRS:
    if all(_factor(axis) == 1.0 for axis in part.axis_info):
        return part
    json = part.to_json_dict()
    # The projection's own parameters keep their units; only the axes change. Code and area no longer apply.
    for axis in json["coordinate_system"]["axis"]:
        axis["unit"] = "metre"
    for key in ("id", "ids"):
        json.pop(key, None)
    json["name"] = re.sub(r"\s*\((ft\w*|[^()]*f(oo|ee)t[^()]*)\)$", "", part.name)
    if part.is_vertical:
        # NAVD88 in feet has a sibling in metres with a code of its own, which other programs know.
        known = CRS.from_json_dict(json)
        code = known.to_epsg(min_confidence=90)
        if code is not None and CRS.from_epsg(code).equals(known):
            return CRS.from_epsg(code)
    return CRS.from_json_dict({**json, "name": f"{json['name']} in metres"})


def _same(a: CRS, b: CRS) -> bool:
    return bool(a == b or a.equals(b, ignore_axis_order=True))


def horizontal(crs: CRS | None) -> CRS | None:
    """The horizontal part of a compound reference system: zones are flat polygons."""
    if crs is not None and crs.is_compound:
        return CRS(crs.sub_crs_list[0])
    return crs


def same_horizontal(a: CRS, b: CRS) -> bool:
    """Whether places in plan have the same coordinates in both, whatever heights they count."""
    first, second = horizontal(a), horizontal(b)
    return first is not None and second is not None and _same(first, second)
