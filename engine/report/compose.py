"""The report of a run: one HTML file that holds its pictures, made of ``run.json`` and the files of its folder."""

from __future__ import annotations

from html.parser import HTMLParser
from pathlib import Path
from typing import TYPE_CHECKING, Any

from markupsafe import Markup

from ...interface.language import current_language, translator
from ...interface.parameters import (
    PUBLISHED_WORKFLOW,
    PUBLISHED_WORKFLOW_ID,
    DetailParameters,
    Specification,
    command_sets,
)
from ...interface.rates import RULE
from ..core.errors import EngineError, InputError
from ..core.json_shapes import read_json
from ..core.messages import shown
from ..core.part_folders import settle
from ..core.progress import Progress
from ..core.staged_outputs import atomic_output
from ..core.templates import render
from ..zones.confirmation import VERDICTS
from .figures import Figures, number
from .record_shape import inside, run_record
from .reviews import zone_reviews

if TYPE_CHECKING:
    from .motion import MotionSection

REPORT = "report.html"
_NO_RECORD = "{path} is no run record that can be read ({why}); give the output folder of a run, or make it again."
_TEMPLATES = Path(__file__).resolve().parent / "templates"
_REPORTED = {
    *command_sets.SERIES,
    *command_sets.CHANGE,
    *command_sets.INSPECT,
    *command_sets.DEMCHANGE,
    *command_sets.DISPLACEMENT,
    *command_sets.M3C2,
}
_MAX_ZONES, _MAX_PROFILES = 40, 12
_ROLES = {
    "epoch": "survey of {0}",
    "roi": "region of interest",
    "stable": "stable ground",
    "profiles": "lines of profiles",
    "transform": "given transformation",
    "alerts": "table of alerts",
    "centreline": "centreline of the road",
    "field_names": "names of fields",
    "classes": "classes of asset",
    "corrections": "corrections by hand",
}
"""What an input is for, by the first word of its role in the record."""
MEANINGS = {
    "confirmed": "significant change of the zone’s sign on 30 % or more of what was compared of it",
    "confirmed in part": "on 15 % or more, of a zone of many cells",
    "contradicted": "significant change of the other sign on more than half of it",
    "not confirmed": "no such change: the shape may be old, or the movement below the level of detection",
    "not measured": "too little of the zone has points of both surveys",
}


def write_report(
    folder: Path,
    progress: Progress | None = None,
    target: Path | None = None,
    *,
    record: str = "run.json",
    pictures: Path | None = None,
) -> Path:
    """Write ``report.html`` into an output folder of ``inspect``, ``change``, ``displacement`` or ``series``; its path.

    It is made of that folder alone, in the language of the environment, so that the same folder gives the same bytes.

    Args:
        target: another file to write.
        record: name of the run record.
        pictures: folder of the other outputs, if another.

    Raises:
        InputError: the folder holds no record of such a run, or a file of it cannot be read.
    """
    folder = Path(folder)
    target = target or folder / REPORT
    with atomic_output(target, check_report) as partial:
        _write(partial, compose(read_record(folder, record), pictures or folder, progress=progress))
    return target


def compose(
    record: dict[str, Any], folder: Path, profiles: Path | None = None, *, progress: Progress | None = None
) -> str:
    """The report of a run record as HTML, in the language of the environment.

    Args:
        folder: of the run's outputs.
        profiles: table of the profiles' cells, if another than that of the folder.
        progress: gets a line where the words in pictures stay English for want of a font.

    Raises:
        InputError: the record is of no such run, or a file of the folder cannot be read.
    """
    # matplotlib takes half a second to import; nothing else of the engine should wait for it
    from ..maps.picture_words import say_missing_font

    say_missing_font(progress)
    context = {
        "record": record,
        "metrics": record["metrics"],
        "fig": Figures(record),
        "css": Markup((_TEMPLATES / "report.css").read_text(encoding="utf-8")),
        "settings": _settings(record["parameters"]),
        "role_words": role_words,
        "details": _details(record),
        "published": {"title": PUBLISHED_WORKFLOW, "id": PUBLISHED_WORKFLOW_ID},
    }
    if record.get("epochs"):
        template, more = "change.html.j2", _change_context(record, folder, profiles or folder / "profiles.csv")
    elif record["command"] == "series":
        template, more = "series.html.j2", _series_context(record, folder)
    elif record["command"] == "m3c2":
        template, more = "m3c2.html.j2", _face_context(record, folder)
    elif record.get("displacement"):
        template, more = "displacement.html.j2", _motion_context(record, folder)
    elif "screened_zone_count" in record["metrics"]:
        template, more = "screening.html.j2", _screening_context(record, folder)
    else:
        raise InputError(
            f"{shown(folder / 'run.json')} is no record of a change, a motion or a screening; give the folder of such "
            "a run."
        )
    return render(_TEMPLATES / template, current_language(), **(context | more))


def read_record(folder: Path, name: str = "run.json") -> dict[str, Any]:
    """The run record of an output folder.

    Raises:
        InputError: there is none, or it is damaged.
    """
    settle(folder)
    try:
        return dict(read_json(folder / name, run_record, _NO_RECORD))
    except FileNotFoundError as error:
        raise InputError(f"{shown(folder)} holds no run.json; give the output folder of a run.") from error


def _write(path: Path, text: str) -> None:
    # a file name that is no Unicode is written with escapes rather than not at all
    path.write_text(text, encoding="utf-8", errors="backslashreplace", newline="\n")


def check_report(path: Path) -> None:
    """Raise EngineError if the file refers to anything outside of itself, or leaves an element open."""
    parser = _Checker()
    parser.feed(path.read_text(encoding="utf-8"))
    parser.close()
    if parser.faults or parser.open:
        raise EngineError(f"{path.name} is not sound: {', '.join(parser.faults or parser.open)}")


class _Checker(HTMLParser):
    """Collects what must not be in a report that stands alone."""

    _VOID = frozenset({"meta", "img", "br", "hr", "link", "input", "source", "wbr", "col"})

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.faults: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        if tag not in self._VOID:
            self.open.append(tag)
        if tag in ("script", "link", "iframe", "object", "embed"):
            self.faults.append(f"an element {tag}")
        for name, value in attrs:
            wanted = {"src": "data:", "href": "#"}.get(name)
            if wanted and not (value or "").startswith(wanted):
                self.faults.append(f"a reference {value}")

    def handle_endtag(self, tag: str) -> None:
        if not self.open or self.open.pop() != tag:
            self.faults.append(f"a stray end of {tag}")


def _change_context(record: dict[str, Any], folder: Path, profile_table: Path) -> dict[str, Any]:
    from ..zones.profiles import read_profiles
    from . import charts, maps
    from .embedding import photograph
    from .ground import ground_section
    from .motion import near_lines

    epochs = [epoch["name"] for epoch in record["epochs"]]
    profiles, motion = record.get("profiles") or [], record.get("displacement")
    tables = read_profiles(profile_table) if profiles else {}
    drawn = profiles[:_MAX_PROFILES]
    near = near_lines(folder / "displacement.gpkg", profile_table.with_name("profiles.gpkg")) if motion else {}
    pictures = {
        "change": maps.change_map(folder, record["colour_limit_m"], (epochs[0], epochs[1])),
        "heatmap": photograph(
            folder / "heatmap.png", "The change, half-transparent over the later survey from above", 1000
        ),
        "histogram": charts.change_histogram(record),
        "stable": charts.stable_histogram(record),
        "hillshade": maps.hillshades(folder),
        "density": maps.densities(folder),
        "cell_sizes": maps.cell_sizes(folder),
        "profiles": [
            charts.profile_chart(facts, tables.get(facts["name"]), (epochs[0], epochs[1]), near.get(facts["name"]))
            for facts in drawn
        ],
        "screening": _screening_picture(record, folder),
    }
    return {
        "epochs": record["epochs"],
        "ground": ground_section(record, folder),
        "motion": _motion(record, folder, (epochs[0], epochs[1])),
        "registration": record.get("registration") or {},
        "coregistration": record.get("coregistration") or [],
        "whole_pair": _whole_pair(record, epochs),
        "stable_given": any(i["role"] == "stable" for i in record["inputs"]),
        "lod": record.get("level_of_detection") or {},
        "pictures": pictures,
        "gap": f"{maps.GAP:g}",
        "most_zones": _MAX_ZONES,
        "zones_file": "zones.gpkg",
        "most_profiles": _MAX_PROFILES,
        "verdicts": _verdicts(),
        "reviews": zone_reviews(folder / "zones.gpkg"),
        "screened_reviews": zone_reviews(folder / "screened_zones.gpkg"),
    }


def _motion(record: dict[str, Any], folder: Path, epochs: tuple[str, str]) -> MotionSection | None:
    from .motion import MotionFiles, motion_section

    return motion_section(record.get("displacement"), MotionFiles.of(folder), epochs)


def _motion_context(record: dict[str, Any], folder: Path) -> dict[str, Any]:
    """Of the command ``displacement``, whose surveys are known by the roles of its inputs."""
    roles = [str(i["role"]) for i in record["inputs"]]
    days = [role.removeprefix("epoch ") for role in roles if role.startswith("epoch ")]
    epochs = (days[0], days[1]) if len(days) == 2 else ("", "")
    return {"days": days, "motion": _motion(record, folder, epochs)}


def _face_context(record: dict[str, Any], folder: Path) -> dict[str, Any]:
    """Of the command ``m3c2``."""
    from . import maps
    from .embedding import photograph

    epochs = [str(i["role"]).removeprefix("epoch ") for i in record["inputs"] if str(i["role"]).startswith("epoch ")]
    return {
        "epochs": epochs,
        "lod": record.get("level_of_detection") or {},
        "pictures": {
            "face": photograph(folder / "m3c2_face.png", "Distances on the face, seen square to its plane", 1000),
            "change": maps.distance_map(folder, record["colour_limit_m"], (epochs[0], epochs[1])),
        },
        "most_zones": _MAX_ZONES,
        "zones_file": "m3c2_zones.gpkg",
        "reviews": zone_reviews(folder / "m3c2_zones.gpkg"),
    }


def _whole_pair(record: dict[str, Any], epochs: list[str]) -> int:
    """Which of the pairs of elevation models the products are of: the first and the last."""
    pairs = [(row["from"], row["to"]) for row in record.get("coregistration") or []]
    return pairs.index((epochs[0], epochs[1])) if (epochs[0], epochs[1]) in pairs else 0


def _series_context(record: dict[str, Any], folder: Path) -> dict[str, Any]:
    from .charts import COURSES, course_chart, motion_chart
    from .embedding import photograph
    from .ground import ground_section
    from .series_words import colours, grouped, levels_of, unit_of_rates, verdict

    roles = [str(i["role"]) for i in record["inputs"]]
    words = "Map of the velocity of each cell, with the zones in the colours of their alert levels"
    return {
        "record": record | {"warnings": grouped(record["warnings"])},
        "named": bool((record["parameters"].get(DetailParameters.record_name) or {}).get("slope_name")),
        "verdict": verdict(record),
        "rates": unit_of_rates(record),
        "rate_rule": RULE,
        "colours": colours(record),
        "levels": levels_of(record, _MAX_ZONES),
        "days": [role.removeprefix("epoch ") for role in roles if role.startswith("epoch ")],
        "pictures": {
            "series": photograph(folder / "series.png", words, 1000),
            "course": course_chart(record),
            "motion": motion_chart(record),
        },
        "moving": [zone for zone in record["zones"] or [] if zone.get("motion_zone")],
        "ground": ground_section(record, folder),
        "courses": [zone["zone_id"] for zone in (record["zones"] or [])[:COURSES]] if record.get("course") else [],
        "most_zones": _MAX_ZONES,
        "reviews": zone_reviews(folder / "series.gpkg"),
    }


def _screening_context(record: dict[str, Any], folder: Path) -> dict[str, Any]:
    from .ground import ground_section

    roles = [str(i["role"]) for i in record["inputs"]]
    survey = next((role.removeprefix("epoch ") for role in roles if role.startswith("epoch ")), "")
    return {
        "survey": survey,
        "ground": ground_section(record, folder),
        "pictures": {"screening": _screening_picture(record, folder)},
        "verdicts": _verdicts(),
        "screened_reviews": zone_reviews(folder / "screened_zones.gpkg"),
    }


def _screening_picture(record: dict[str, Any], folder: Path) -> Any:
    from .embedding import photograph

    picture = inside(folder, record["outputs"].get("screened_map", ""))
    if picture is None:
        return None
    return photograph(picture, "Map of the screened zones, seen from above", 1000)


def _verdicts() -> list[tuple[str, str, str]]:
    return [(f"{word.replace(' ', '_')}_zones", word, MEANINGS[word]) for word in VERDICTS]


def role_words(role: str) -> str:
    """What an input is for, in the language of the report."""
    kind, _, name = role.partition(" ")
    return translator(current_language())(_ROLES.get(kind, role)).replace("{0}", name)


def _details(record: dict[str, Any]) -> list[tuple[str, str]]:
    """What was given of slope, people and flights, with the labels of the dialogs."""
    given = record["parameters"].get(DetailParameters.record_name) or {}
    return [(s.label, given[s.name]) for s in DetailParameters.specifications() if s.kind is str and given.get(s.name)]


def _settings(parameters: dict[str, dict[str, Any]]) -> list[dict[str, Any]]:
    """The groups of settings with their labels; ``own`` are those that differ from the defaults."""
    known = _specifications()
    groups = []
    for group, values in parameters.items():
        if group == DetailParameters.record_name:  # they stand at the top
            continue
        settings = []
        for name, value in values.items():
            specification = known.get((group, name))
            label = specification.label if specification else name
            own = specification is not None and value not in (specification.default, specification.auto_number)
            settings.append({"label": label, "shown": _shown(value, specification), "own": own})
        groups.append({"name": group.replace("_", " ").capitalize(), "settings": settings})
    return groups


def _specifications() -> dict[tuple[str, str], Specification]:
    """By the names of the set and of the parameter in a record."""
    return {(group.record_name, s.name): s for group in _REPORTED for s in group.specifications()}


def _shown(value: Any, specification: Specification | None) -> str:
    if isinstance(value, bool):
        return "yes" if value else "no"
    if value == "":
        return "–"
    text = f"{value:g}" if isinstance(value, float) else number(value, 0) if isinstance(value, int) else str(value)
    unit = specification.unit if specification and not isinstance(value, str) else ""
    if unit == "degrees":
        return f"{text}°"
    return f"{text} {unit}" if unit else text
