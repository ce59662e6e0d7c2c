"""Which layers of a finished run's folder belong into a project: their titles, groups and days, by the run's record."""

from __future__ import annotations

import json
import re
import sqlite3
from contextlib import closing
from dataclasses import dataclass, replace
from pathlib import Path, PurePosixPath
from typing import Any

ZONES, CHANGE, SURVEYS, SCREENING, SLOPES, FLIGHT, TABLES, MORE = (
    "Zones and sections", "Change", "Surveys", "Screening", "Slopes", "Flight", "Tables", "More",
)  # fmt: skip
GROUPS = (ZONES, CHANGE, SCREENING, FLIGHT, SLOPES, SURVEYS, TABLES, MORE)
"""From the top of the layer tree."""
EARLIER, LATER = "Earlier survey", "Later survey"
"""Groups of two surveys whose days are not known."""
Days = tuple[str, str]


class NoRunError(Exception):
    """The folder holds no finished run; the message says so in one sentence."""


@dataclass(frozen=True)
class Entry:
    """A layer of the project.

    ``layer`` is that of a GeoPackage, ``bands`` the titles of a raster's bands where each becomes a layer of heights,
    ``days`` when it is shown by the temporal controller: after the first until the second. ``survey`` is the day of the
    group below ``group``, or ``EARLIER`` or ``LATER`` where no day is known, empty for none, and ``surveys`` those of
    the bands; ``slope`` the name of such a group instead, of a slope of a corridor.
    """

    path: Path
    title: str
    group: str
    layer: str = ""
    survey: str = ""
    visible: bool = False
    days: Days | None = None
    bands: tuple[str, ...] = ()
    surveys: tuple[str, ...] = ()
    slope: str = ""


@dataclass(frozen=True)
class Contents:
    """The entries from the top of each group on; ``zones`` is the one whose table the print layout shows."""

    folder: Path
    title: str
    command: str
    days: tuple[str, ...]
    entries: tuple[Entry, ...]
    zones: Entry | None


# key of the run's output and layer: title, group, whether it is shown
_LAYERS: dict[tuple[str, str], tuple[str, str, bool]] = {
    ("corridor", "alerts"): ("Alerts", ZONES, True),
    ("corridor", "zones"): ("Zones of all slopes", ZONES, True),
    ("corridor", "slopes"): ("Slopes", ZONES, True),
    ("displacement_vectors", "zones"): ("Zones of coherent motion", ZONES, True),
    ("displacement_vectors", "velocities"): ("Velocity vectors along the surface", ZONES, True),
    ("displacement_vectors", "vectors"): ("Displacement vectors", ZONES, True),
    ("displacement_vectors", "steps"): ("Displacement vectors since the survey before", ZONES, False),
    ("displacement_vectors", "one_direction"): ("Motion known in one direction", ZONES, False),
    ("series_zones", "zones"): ("Zones and alert levels", ZONES, True),
    ("series_zones", "series"): ("Zones survey by survey", ZONES, False),
    ("zones", "zones"): ("Hazard zones", ZONES, True),
    ("m3c2_zones", "zones"): ("Zones along the normal (M3C2)", ZONES, True),
    ("m3c2_zones", "footprints"): ("Footprints of the M3C2 volumes", ZONES, False),
    ("m3c2_zones", "unsure"): ("Unsure M3C2 change", ZONES, False),
    ("m3c2_zones", "volumes"): ("Volumes along the normal", TABLES, False),
    ("objects", "objects"): ("Objects above the ground", ZONES, True),
    ("profiles", "profiles"): ("Lines of the profiles", ZONES, True),
    ("zones", "footprints"): ("Footprints of the volumes", ZONES, False),
    ("zones", "unsure"): ("Unsure change", ZONES, False),
    ("zones", "not_seen"): ("Not seen", CHANGE, True),
    ("series_zones", "not_seen"): ("Not seen", CHANGE, True),
    ("classes", "budget_by_class"): ("Change by class of asset", ZONES, False),
    ("screened_zones", "zones"): ("Screened zones", SCREENING, False),
    ("located", "*"): ("Places on the road", ZONES, True),
    ("plan", "lines"): ("Flight lines", FLIGHT, True),
    ("plan", "waypoints"): ("Waypoints", FLIGHT, True),
    ("plan", "places"): ("What the plan promises", FLIGHT, False),
    ("comparison", "lines"): ("Flight lines as planned", FLIGHT, True),
    ("comparison", "flown"): ("Way flown", FLIGHT, True),
    ("comparison", "places"): ("Places promised and reached", FLIGHT, True),
    ("zones", "volumes"): ("Volumes", TABLES, False),
}
_RASTERS: dict[str, tuple[str, str, bool]] = {
    "significant_change": ("Significant change (m)", CHANGE, True),
    "seen": ("Seen and not seen", CHANGE, False),
    "elevation_change": ("Elevation change (m)", CHANGE, False),
    "velocity": ("Velocity (mm/day)", CHANGE, True),
    "velocity_error": ("Standard error of the velocity (mm/day)", CHANGE, False),
    "epochs_confirmed": ("Comparisons that confirm", CHANGE, False),
    "displacement": ("Displacement (m)", CHANGE, False),
    "smallest_motion": ("Smallest motion that can be told (m)", CHANGE, False),
    "m3c2_significant": ("Significant M3C2 distance (m)", CHANGE, True),
    "m3c2_distance": ("M3C2 distance (m)", CHANGE, False),
    "m3c2_level_of_detection": ("Level of detection of M3C2 (m)", CHANGE, False),
    "significance": ("Significance (standard errors)", CHANGE, False),
    "rate": ("Rate (mm/year)", CHANGE, False),
    "mosaic": ("Elevation change (m)", CHANGE, True),
    "level_of_detection": ("Level of detection (m)", CHANGE, False),
    "change_probability": ("Probability of change", CHANGE, False),
    "cell_size": ("Size of the cells (m)", CHANGE, False),
    "plant_error": ("Error by plants (m)", CHANGE, False),
    "plant_change": ("Change that plants explain (m)", CHANGE, False),
    "screened_probability": ("Probability of a hazard (screening)", SCREENING, False),
    "screened_smallest_hazard": ("Smallest hazard (m, screening)", SCREENING, False),
    "probability": ("Probability of a hazard", SCREENING, True),
    "smallest_hazard": ("Smallest hazard (m)", SCREENING, False),
    "heatmap_raster": ("Heatmap", MORE, False),
    "point_counts": ("Ground points in each cell", MORE, False),
    "top_view": ("Top view", SURVEYS, True),
    "expected_ground": ("Expected ground returns (1/m²)", FLIGHT, True),
    "expected_returns": ("Expected returns (1/m²)", FLIGHT, False),
    "expected_level": ("Expected level of detection (m)", FLIGHT, False),
    "expected_motion": ("Smallest motion that is expected to show (m)", FLIGHT, False),
}
_HEIGHTS = "surface_heights"
_HEIGHT_TITLES = ("Ground heights, earlier survey (m)", "Ground heights, later survey (m)")
_ROW_A_SURVEY = {("displacement_vectors", "zones"), ("displacement_vectors", "vectors")}
"""In a series these have a row a survey, which lie on each other without the temporal controller."""
_OF_SURVEYS = re.compile(r"(cumulative|incremental)_(change|level|seen)_\d+")
_OF_MODELS = re.compile(r"(elevation_change|level_of_detection)_(\d+)_(\d+)")
"""Of elevation models, which are counted from 1."""
_SPAN = re.compile(r"(\d{4}-\d{2}-\d{2})_(\d{4}-\d{2}-\d{2})$")
_SURVEY_TITLES = {
    "cumulative_change": "Change since the first survey", "incremental_change": "Change since the survey before",
    "cumulative_level": "Level of detection since the first survey",
    "incremental_level": "Level of detection since the survey before",
    "cumulative_seen": "Seen and not seen since the first survey",
    "incremental_seen": "Seen and not seen since the survey before",
}  # fmt: skip
_MAIN = (("series_zones", "zones"), ("corridor", "zones"), ("zones", "zones"), ("displacement_vectors", "zones"))
"""Layers of zones, the one first that a print layout lists."""


def read_contents(run: str) -> Contents:
    """What the folder of a finished run holds for a project.

    Raises:
        NoRunError: there is no run record, or it cannot be read, or it names no layers that are there.
    """
    path = Path(run)
    record_path = path if path.is_file() else path / "run.json"
    if not record_path.is_file():
        several = [one for one in sorted(path.glob("*_run.json")) if _is_of_results(one)]
        if len(several) != 1:
            raise NoRunError(f"{run} holds no run.json, so no finished run; give the output folder of a run.")
        record_path = several[0]
    command, days, files, entries = _read(record_path)
    folder = record_path.parent.absolute()
    if command == "batch" and "corridor" in files:
        of_slopes, days = _of_slopes(folder, files["corridor"])
        entries += of_slopes
    if not entries:
        raise NoRunError(f"{folder} holds no layers, or they are gone; make the run of {command} again.")
    order = sorted(entries, key=lambda e: GROUPS.index(e.group))
    main = (e for key, name in _MAIN for e in entries if e.path == files.get(key) and e.layer == name)
    return Contents(folder, folder.name, command, days, tuple(order), next(main, None))


def _read(record_path: Path) -> tuple[str, tuple[str, ...], dict[str, Path], list[Entry]]:
    """The command of a run record, the days of its surveys, the files that are there, and the layers in them."""
    try:
        record = json.loads(record_path.read_text(encoding="utf-8"))
        outputs = {str(key): str(name) for key, name in record["outputs"].items()}
        command = str(record["command"])
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        raise NoRunError(f"{record_path} is no run record that can be read; give the output folder of a run.") from None
    folder = record_path.parent.absolute()
    days = _days(record)
    files = {key: folder / name for key, name in outputs.items() if _is_inside(name) and (folder / name).is_file()}
    return command, days, files, [*_vectors(files), *_rasters(files, days)]


def _of_slopes(folder: Path, corridor: Path) -> tuple[list[Entry], tuple[str, ...]]:
    """What the project of each slope shows at first, in a group of its name and off; days of all surveys."""
    try:
        with closing(sqlite3.connect(f"{corridor.absolute().as_uri()}?mode=ro", uri=True)) as database:
            query = "SELECT slope, report FROM slopes WHERE state = 'done' ORDER BY place"
            rows = [(str(slope), str(report or "")) for slope, report in database.execute(query)]
    except sqlite3.Error:  # an older corridor has no such layer
        return [], ()
    found: list[Entry] = []
    surveyed: set[str] = set()
    for slope, report in rows:
        record = (folder / report).parent / "run.json"
        if report and _is_inside(report) and record.is_file():
            _, days, _, entries = _read(record)
            surveyed.update(days)
            shown = [entry for entry in entries if entry.visible] or [e for e in entries if e.group == SCREENING]
            found += [replace(entry, group=SLOPES, survey="", slope=slope, visible=False) for entry in shown]
    return found, tuple(sorted(surveyed))


def _is_of_results(record: Path) -> bool:
    """Whether a run record is of another command than a hand-over, whose archive may lie next to results."""
    try:
        return bool(json.loads(record.read_text(encoding="utf-8"))["command"] != "exportgis")
    except (OSError, ValueError, KeyError, TypeError):
        return False


def _is_inside(name: str) -> bool:
    parts = PurePosixPath(name.replace("\\", "/")).parts
    return bool(parts) and ".." not in parts and not Path(name).is_absolute()


def _days(record: dict[str, Any]) -> tuple[str, ...]:
    named = [one.get("date") for one in record.get("epochs") or () if isinstance(one, dict)]
    named = named or list(record.get("dates") or ())
    roles = [str(one.get("role", "")) for one in record.get("inputs") or () if isinstance(one, dict)]
    named = named or [role.partition(" ")[2] for role in roles if role.startswith("epoch ")]
    return tuple(sorted({str(day) for day in named if day and re.fullmatch(r"\d{4}-\d{2}-\d{2}", str(day))}))


def _vectors(files: dict[str, Path]) -> list[Entry]:
    hidden = _ROW_A_SURVEY if "series_zones" in files else set()
    return [
        Entry(files[key], title, group, layer=name, visible=visible and (key, layer) not in hidden)
        for (key, layer), (title, group, visible) in _LAYERS.items()
        if key in files and files[key].suffix == ".gpkg"
        for name in (_names(files[key]) if layer == "*" else [layer])
    ]


def _names(package: Path) -> list[str]:
    """Names of the layers of a GeoPackage."""
    try:
        with closing(sqlite3.connect(f"{package.absolute().as_uri()}?mode=ro", uri=True)) as database:
            query = "SELECT table_name FROM gpkg_contents WHERE data_type = 'features' ORDER BY table_name"
            return [str(row[0]) for row in database.execute(query)]
    except sqlite3.Error:
        return []


def _rasters(files: dict[str, Path], days: tuple[str, ...]) -> list[Entry]:
    pair = (days[0], days[-1]) if len(days) > 1 else None
    two = pair or ((EARLIER, LATER) if _HEIGHTS in files else None)
    found = []
    if _HEIGHTS in files:
        found.append(Entry(files[_HEIGHTS], "", SURVEYS, bands=_HEIGHT_TITLES, days=pair, surveys=two or ()))
    for key, (title, group, visible) in _RASTERS.items():
        if key in files:
            survey = two[1] if two and group == SURVEYS else ""  # the picture from above is of the later one
            span = pair if group == CHANGE else None
            found.append(Entry(files[key], title, group, survey=survey, visible=visible, days=span))
    for key in sorted(files, reverse=True):
        kind, dated = _OF_SURVEYS.fullmatch(key), _SPAN.search(files[key].stem)
        if kind and dated:
            title = _SURVEY_TITLES[f"{kind[1]}_{kind[2]}"]
            newest = dated[2] == days[-1] if days else False
            visible = newest and kind.groups() == ("cumulative", "change") and "velocity" not in files
            # the engine's style says on which days it is shown
            found.append(Entry(files[key], title, SURVEYS, survey=dated[2], visible=visible))
    return [*found, *_pairs_of_models(files, days)]


def _pairs_of_models(files: dict[str, Path], days: tuple[str, ...]) -> list[Entry]:
    """Change and level of each elevation model against the first one and that before."""
    found = []
    for key in sorted(files, reverse=True):
        pair = _OF_MODELS.fullmatch(key)
        if pair:
            first, last = int(pair[2]), int(pair[3])
            kind = "change" if pair[1] == "elevation_change" else "level"
            title = _SURVEY_TITLES[f"{'cumulative' if first == 1 else 'incremental'}_{kind}"]
            survey, span = ("", None) if last > len(days) else (days[last - 1], (days[first - 1], days[last - 1]))
            found.append(Entry(files[key], title, SURVEYS, survey=survey, days=span))
    return found
