#!/usr/bin/env -S .venv/bin/python
"""The messages of SlopeWatch and their translations: what the code says, and what a catalogue lacks.

``scripts/messages.py`` lists what interface/language/zh_CN.po lacks or has too much; ``--update`` brings the file up to
date: messages that the code no longer has go, new ones come without a translation. Translations are written by hand.

A message is a string or an f-string of two words or more in the packages of PACKAGES, no docstring; what an f-string
puts in is a place: {0}, {1}. In the packages of LABELS a single word with a capital is one, too, as is all text of the
templates in TEMPLATES. Messages that nobody is shown have the comment "not shown" and no translation.
"""

from __future__ import annotations

import argparse
import ast
import json
import re
import sys
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

from slopewatch.engine.core.template_messages import template_messages
from slopewatch.interface import parameters
from slopewatch.interface.choice_words import CHOICE, is_word

ROOT = Path(__file__).resolve().parents[1]
PACKAGES = ("interface", "engine", "models", "workflows", "cli", "plugin", "processing_algorithms")
LABELS = ("interface/parameters", "plugin", "processing_algorithms", "engine/report/signed")
TEMPLATES = "engine/report/templates"
FIELDS = "engine/maps/styles/fields.json"
"""What analysts read instead of the names of columns."""
COMPOSED = (
    "a number",
    "a whole number",
    "a list",
    "a text",
    "an object",
    "{0} of at least {1}",
    "{0} above {1}",
    "{0} of at least {1} and at most {2}",
    "{0} above {1} and at most {2}",
    "one of {0}",
    "{0} is {1}; give {2}.",
    "{0} is {1}; give {2}, or auto.",
    "{0} failed: {1}",
    "{0} confirmed, {1} not confirmed",
    "{0} (arrows × {1})",
    "Line {0}",
    "Feature {0}",
    "Folder {0}",
    "No zones",
    "{0} severity",
    "high severity, {0} of up to {1} m",
    "moderate severity, {0} of up to {1} m",
    "high confidence of the screening, {0} of up to {1} m",
    "high severity, {0} by {1} m",
    "moderate severity, {0} by {1} m",
    "attention {0}",
    "of class 2 inside the area {0}",
    "of the ground inside the area {0}",
    "screening ({0})",
    "a matched filter ({0})",
    "{0}, other weights",
    "M3C2 distance",
    "first survey",
    "reference",
    "[next to the labelled cloud]",
    "M3C2 distances",
    "Error: {0}",
    "Warning: {0}",
    "[default: {0}]",
    "[required]",
    "Missing option {0}.",
    "Missing argument {0}.",
    "No such option: {0}",
    "No such option: {0} Did you mean {1}?",
    "Invalid value for {0}: {1}",
    "Got unexpected extra argument ({0})",
    "No such command {0}.",
    "Show this message and exit.",
    "Show the version and exit.",
    "{0} is not one of {1}.",
    "{0} zones of significant change were found, {1} in all: {2} lost and {3} gained.",
    "1 zone of significant change was found, {0} in all: {1} lost and {2} gained.",
    "{0} zones of ground that looks raised or lowered were found, {1} in all: {2} raised, {3} lowered.",
    "1 zone of ground that looks raised or lowered was found, {0} in all: {1} raised, {2} lowered.",
    "By its shape, {0} zones of the last survey look raised or lowered; the change confirms {1} of them.",
    "By its shape, 1 zone of the last survey look raised or lowered; the change confirms {0} of them.",
    "{0} points of a slope that dips by {1} degrees were looked at.",
    "The later survey was moved by {0} to the east, {1} to the north and {2} upwards to fit the earlier one.",
    (
        "The later survey was moved by {0} to the east, {1} to the north and {2} upwards to fit the earlier "
        "one, with a standard error of {3} in height."
    ),
    "{0} zones moved, {1} of them confirmed by two comparisons or more.",
    "{0} zones moved, {1} of them confirmed by two comparisons or more; the fastest by {2}.",
    "1 zone moved, {0} of them confirmed by two comparisons or more.",
    "1 zone moved, {0} of them confirmed by two comparisons or more; the fastest by {1}.",
    "{0} slopes failed; the table of slopes says why.",
    "1 slope failed; the table of slopes says why.",
    "{0} files were written to {1}.",
    "1 file was written to {0}.",
    "Look first at {0} and {1}.",
    "{0} warnings were given, which the run record keeps; read them first.",
    "{0} warnings were given; read them first.",
    "1 warning was given, which the run record keeps; read them first.",
    "1 warning was given; read them first.",
    "A GeoPackage (.gpkg).",
    "[{0} in the output folder]",
    "[next to the core points]",
    "Got unexpected extra arguments ({0})",
    "Internal failure: {0}: {1} ({2}, line {3}); please report it.",
    "Elevation change, {0} to {1}",
    "Level of detection, {0} confidence, {1} to {2}",
    "Hillshade of the lowest returns, 0 to 255",
    "Hillshade of the highest returns, 0 to 255",
    "Height of the highest return over the ground (class 2)",
    "Height of the highest return over the ground (estimate)",
    "Downloading {0}",
    "Cut: {0}.",
    "{0} in {1}",
    " off",
    "{0} m² below {1}",
    "lowest returns",
    "highest returns",
    "; please report it",
    ", or leave it empty",
    "Not set:",
    " (median {0} m)",
    "{0} zones.",
    "1 zone.",
    "{0} zones found",
    "No zones found",
    "1 zone found",
    "height (m)",
    "change (m)",
    "area (m²)",
    "points/m²",
    "Screening",
    "Uplift",
    "Subsidence",
    "Sliding",
    "Confirmed",
    "Rejected",
    "Unreviewed",
    "Lowered",
    "Raised",
    "Below its level",
    "Alert raised",
    "Alert acknowledged",
    "Alert closed",
    "Attention {0}",
    "Areal",
    "Volumetric",
    "Vertical averages",
    "Percentages (by volume)",
    "Zones (over their footprints)",
    "Average Total Thickness of Difference for Area of Interest",
    "Average Net Thickness of Difference for Area of Interest",
    "Average Total Thickness of Difference for Area with Detectable Change",
    "Average Net Thickness of Difference for Area with Detectable Change",
    "no confirmed change",
    "inspect soon",
    "inspect at once",
    "Next survey as planned",
    "Look at it after the next survey",
    "Inspect on site and survey more often",
    "Inspect within days and consider instruments that measure continuously",
    "Inspect at once and decide on closing the road",
    "Inputs",
    "Dates",
    "Series",
    "mm/day",
    "mm/month",
    "mm/year",
    "Interpreter: {0} ({1})",
    "{0} to {1}",
    "Area (m²)",
    "95 % interval",
    "Error (%)",
    "Height (m)",
    "Days",
    "Rate",
    "Velocity",
    "Velocity (mm/day)",
    "Rate (mm/day)",
    "Change (m)",
    "Mean change (m)",
    "Mean (m)",
    "Net volume (m³)",
    "Place (x, y)",
    "Largest height (m)",
    "UAV",
    "Largest volume (m³)",
)
"""Messages that the code puts together of parts that do not stand alone."""
WORDS = (
    "new", "continued", "split", "merged", "left", "right",
    ",", "above", "and", "below", "confirmed", "contradicted", "coordinates", "Coordinates", "cumulative",
    "earlier", "first", "ground", "heights", "lowered", "raised", "incremental", "inspect",
    "boulder", "wall", "vegetation", "appeared", "vanished",
    "sliding", "sank", "bulged", "slid", "lost", "gained", "undecided",
    "acknowledged", "closed", "observe", "plants", "points", "registration",
    "Heights", "high", "higher", "it", "later", "low", "lower", "lowering", "manifest", "moderate", "no", "raising",
    "rapid", "rejected", "risen", "rise", "setting", "sink", "slow", "steady", "subsidence", "sunk", "tilt", "them",
    "unsure", "Options", "Installation", "by", "run", "medium", "robust",
    "reached", "kept", "withdrawn", "Fastest", "Compared", "accelerating", "decelerating", "irregular",
    "Batch", "Labelling", "Region", "Training", "days", "degrees", "minutes",
    "motion", "both",
    "Commands", "Examples", "Files", "Parameters", "Running", "trees", "unreviewed", "unknown", "uplift", "yes",
)  # fmt: skip
"""Single words that stand in places of other messages, or alone in a table of the report."""
LEFT_OUT = ("interface/language",)
CATALOGUE = ROOT / "interface" / "language" / "zh_CN.po"
NOT_SHOWN = "#. not shown"
_LABEL = re.compile(r"[A-Z][a-z]{2,}(?:-[a-z]+)*…?")
_WORD = re.compile(r"[A-Za-z]{2,}")
_PLACE = re.compile(r"(?<!\{)\{\w*\}(?!\})")


@dataclass
class Entry:
    """A message of a catalogue: where it stands in the code, its translation, whether nobody is shown it."""

    message: str
    places: list[str] = field(default_factory=list)
    translation: str = ""
    not_shown: bool = False

    def text(self) -> str:
        lines = [f"#: {place}" for place in self.places[:3]]
        lines += [NOT_SHOWN] if self.not_shown else []
        return "\n".join([*lines, f"msgid {quoted(self.message)}", f"msgstr {quoted(self.translation)}"])


def messages(root: Path = ROOT) -> dict[str, list[str]]:
    """All messages of the code and the files that have them."""
    found: dict[str, list[str]] = {}
    for package in PACKAGES:
        for path in sorted((root / package).rglob("*.py")):
            name = path.relative_to(root).as_posix()
            if name.startswith(LEFT_OUT):
                continue
            source = path.read_text(encoding="utf-8")
            _add(found, messages_of(source, labels=name.startswith(LABELS)), name)
    for single in (*COMPOSED, *WORDS):
        found.setdefault(single, ["scripts/messages.py"])
    _add(found, choices(), "interface/parameters")
    names = json.loads((root / FIELDS).read_text(encoding="utf-8"))
    _add(found, (field["name"] for field in names.values()), FIELDS)
    for path in sorted((root / TEMPLATES).glob("*.j2")):
        name = path.relative_to(root).as_posix()
        _add(found, template_messages(path.read_text(encoding="utf-8")), name)
    return found


def choices() -> Iterator[str]:
    """What the lists of the dialogs show: each choice of a parameter that is a word, as the dialogs look it up."""
    groups = (group for group in vars(parameters).values() if isinstance(group, type))
    own = (group for group in groups if issubclass(group, parameters.ParameterSet))
    listed = {choice for group in own for s in group.specifications() for choice in s.choices}
    yield from (CHOICE.format(one) for one in sorted(listed | set(parameters.PROFILES)) if is_word(one))


def _add(found: dict[str, list[str]], more: Iterator[str], name: str) -> None:
    for message in more:
        places = found.setdefault(message, [])
        if name not in places:
            places.append(name)


def messages_of(source: str, *, labels: bool = False) -> Iterator[str]:
    """The messages of a module's text, in its order; with ``labels`` single words with a capital, too."""
    tree = ast.parse(source)
    skipped = set(_silent(tree))
    for node in ast.walk(tree):
        if id(node) in skipped:
            continue
        text = _template(node)
        if isinstance(node, ast.FunctionDef) and _is_command(node):
            yield from (" ".join(part.split()) for part in (ast.get_docstring(node) or "").split("\n\n") if part)
        if text is None:
            continue
        is_sentence = " " in text.strip() and len(_WORD.findall(_PLACE.sub("", text))) >= 2
        if is_sentence or (labels and _LABEL.fullmatch(text)):
            yield text


def _is_command(node: ast.FunctionDef) -> bool:
    """Its docstring is what ``--help`` shows."""
    return any(re.search(r"\b(command|group)\b", ast.unparse(one)) for one in node.decorator_list)


def _silent(tree: ast.AST) -> Iterator[int]:
    """Docstrings, patterns, and the parts of f-strings, which are no messages of their own."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute) and node.func.attr == "compile":
            yield from (id(part) for argument in node.args for part in ast.walk(argument))
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant):
            yield id(node.value)
        if isinstance(node, ast.JoinedStr):
            for part in node.values:
                yield id(part)
                if isinstance(part, ast.FormattedValue) and part.format_spec is not None:
                    yield id(part.format_spec)


def _template(node: ast.AST) -> str | None:
    if isinstance(node, ast.Constant) and isinstance(node.value, str):
        return node.value
    if not isinstance(node, ast.JoinedStr):
        return None
    text, places = "", 0
    for part in node.values:
        if isinstance(part, ast.Constant):
            text += str(part.value).replace("{", "{{").replace("}", "}}")
        else:
            text, places = f"{text}{{{places}}}", places + 1
    return text


def catalogue(path: Path = CATALOGUE) -> dict[str, Entry]:
    """The entries of a catalogue as ``written`` writes them."""
    found: dict[str, Entry] = {}
    for block in path.read_text(encoding="utf-8").split("\n\n") if path.is_file() else []:
        lines = block.splitlines()
        values = {line.split(" ", 1)[0]: line.split(" ", 1)[1] for line in lines if line.startswith("msg")}
        if "msgid" in values and ast.literal_eval(values["msgid"]):
            entry = Entry(ast.literal_eval(values["msgid"]), translation=ast.literal_eval(values["msgstr"]))
            entry.places = [line.removeprefix("#: ") for line in lines if line.startswith("#: ")]
            entry.not_shown = NOT_SHOWN in lines
            found[entry.message] = entry
    return found


HEADER = """msgid ""
msgstr "Language: zh_CN\\nMIME-Version: 1.0\\nContent-Type: text/plain; charset=UTF-8\\n"
"""


def updated(found: dict[str, list[str]], old: dict[str, Entry]) -> list[Entry]:
    """An entry for every message, with what was translated before."""
    known = {message: old.get(message, Entry(message)) for message in found}
    return [
        Entry(message, places, known[message].translation, known[message].not_shown)
        for message, places in found.items()
    ]


def written(entries: list[Entry]) -> str:
    """The text of a catalogue: one line a string, so that a change is one line of a comparison."""
    return "\n\n".join([HEADER.strip(), *(entry.text() for entry in entries)]) + "\n"


def quoted(text: str) -> str:
    """A string of a PO file, in one line."""
    for plain, escaped in (("\\", "\\\\"), ('"', '\\"'), ("\n", "\\n"), ("\t", "\\t"), ("\r", "\\r")):
        text = text.replace(plain, escaped)
    return f'"{text}"'


def faults(found: dict[str, list[str]], have: dict[str, Entry]) -> list[str]:
    """What is wrong with a catalogue, a line each."""
    said = [f"no entry: {message!r} ({places[0]})" for message, places in found.items() if message not in have]
    said += [f"not in the code: {message!r}" for message in have if message not in found]
    for entry in have.values():
        if bool(entry.translation) == entry.not_shown:
            said.append(f"neither translated nor marked as not shown, or both: {entry.message!r}")
        elif not entry.not_shown and not _has_its_places(entry):
            said.append(f"other places than the message: {entry.message!r}")
    return said


def _has_its_places(entry: Entry) -> bool:
    """A template's place may be left out: the English "zone" or "zones" needs none elsewhere."""
    wanted, have = sorted(_PLACE.findall(entry.message)), sorted(_PLACE.findall(entry.translation))
    if any(place.startswith(TEMPLATES) for place in entry.places):
        return set(have) <= set(wanted)
    return have == wanted


def main() -> int:
    """1 if the catalogue is not complete."""
    parser = argparse.ArgumentParser(description="What the catalogue of translations lacks.")
    parser.add_argument("--update", action="store_true", help="write the catalogue anew with the messages of the code")
    given = parser.parse_args()
    found = messages()
    if given.update:
        CATALOGUE.write_text(written(updated(found, catalogue())), encoding="utf-8")
    wrong = faults(found, catalogue())
    print("\n".join(wrong) or f"{len(found)} messages, nothing is missing")
    return int(bool(wrong))


if __name__ == "__main__":
    sys.exit(main())
