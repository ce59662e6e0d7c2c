"""The documents: lines that fit, links that lead somewhere, commands and options that exist, words of the glossary."""

from __future__ import annotations

import importlib
import importlib.util
import re
from collections.abc import Iterator
from pathlib import Path

import click
import pytest
from slopewatch.cli.program import cli
from slopewatch.engine.objects import table as objects
from slopewatch.engine.series.tables import SERIES_FIELDS, ZONE_FIELDS
from slopewatch.engine.zones import confirmation, fields
from slopewatch.lab.__main__ import COMMANDS as BENCHMARKS_WITH_OPTIONS
from slopewatch.lab.__main__ import NAMES
from slopewatch.models.screening import zones as screened_zones
from slopewatch.tests.builders.walk import ROOT, faults, text_of
from slopewatch.workflows.last_epoch import SCREENING_OUTPUTS
from slopewatch.workflows.products.change import CHANGE_OUTPUTS, ON_REQUEST
from slopewatch.workflows.products.displacement import DISPLACEMENT_OUTPUTS
from slopewatch.workflows.products.series import SERIES_OUTPUTS

DOCS = sorted((ROOT / "docs").rglob("*.md"))
DOCUMENTS = [*(ROOT / name for name in ("README.md", "CONTRIBUTING.md", "SECURITY.md")), *DOCS]
CHANGELOG = ROOT / "CHANGELOG.md"  # names commands and words of earlier releases
LINE = 140
LARGEST_PICTURE_BYTES = 300_000
GLOSSARY = ROOT / "docs" / "glossary.md"
STARTS = [ROOT / "README.md", ROOT / "docs" / "index.md"]
FOLDERS = sorted(place.name for place in ROOT.iterdir() if place.is_dir() and place.name[0].isalpha())
# Options in the documents that are not those of `slopewatch`.
FOREIGN = {"--recipe"}

MOTION_FILES = tuple(name for name in DISPLACEMENT_OUTPUTS if not name.endswith(".qml"))


def too_long(text: str) -> list[str]:
    """Lines above the limit; an address that alone is longer cannot be wrapped."""
    return [line for line in text.splitlines() if len(line) > LINE and not re.search(r"\bhttps?://\S{100,}", line)]


def without_code(text: str) -> str:
    text = re.sub(r"^```.*?^```", "", text, flags=re.S | re.M)
    text = re.sub(r"^(?: {4}|\t).*$", lambda line: line.group() if "](" in line.group() else "", text, flags=re.M)
    return re.sub(r"`[^`]*`", "", text)


def links(text: str) -> list[str]:
    """Targets of links and pictures, those of other hosts left out."""
    text = re.sub(r"^```.*?^```", "", text, flags=re.S | re.M)
    found = re.findall(r"\]\(\s*([^)\s]+)\s*\)", text) + re.findall(r'<(?:img|a)\b[^>]*\b(?:src|href)="([^"]+)"', text)
    return [target for target in found if not re.match(r"[a-z]+:", target)]


def anchors(text: str) -> set[str]:
    """Names of the headings, as GitHub makes them, and of the anchors that the text sets itself."""
    text = re.sub(r"^```.*?^```", "", text, flags=re.S | re.M)
    names = set(re.findall(r'<a (?:name|id)="([^"]+)"', text))
    for heading in re.findall(r"^#+ +(.+?) *#*$", text, flags=re.M):
        words = re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", heading).lower()
        name = re.sub(r"[^\w\- ]", "", words).replace(" ", "-")
        number = 0
        while (unique := f"{name}-{number}" if number else name) in names:
            number += 1
        names.add(unique)
    return names


def broken_links(path: Path) -> list[str]:
    broken = []
    for target in links(path.read_text(encoding="utf-8")):
        name, _, anchor = target.partition("#")
        file = (path.parent / name).resolve() if name else path
        if not file.exists() or (anchor and anchor not in anchors(file.read_text(encoding="utf-8"))):
            broken.append(target)
    return broken


def code(text: str) -> Iterator[str]:
    """Each piece of code: spans, and lines of blocks with those that they go on in."""
    text = re.sub(r"\\\n\s*", " ", text)
    blocks = re.findall(r"^```\w*\n(.*?)^```", text, flags=re.S | re.M)
    text = re.sub(r"^```.*?^```", "", text, flags=re.S | re.M)
    for block in [*blocks, *re.findall(r"^ {4}(.*)$", text, flags=re.M)]:
        yield from (line.partition("  # ")[0] for line in block.splitlines())
    yield from (" ".join(span.split()) for span in re.findall(r"`([^`]+)`", text))


def options(command: click.Command) -> set[str]:
    named = {o for p in command.params if isinstance(p, click.Option) for o in (*p.opts, *p.secondary_opts)}
    return named | {"--help", "-h", "--version"}


def commands(group: click.Group, before: str = "") -> dict[str, click.Command]:
    """All commands by their words, such as ``simulate survey``."""
    found: dict[str, click.Command] = {}
    for name, command in group.commands.items():
        found[before + name] = command
        if isinstance(command, click.Group):
            found |= commands(command, f"{before}{name} ")
    return found


COMMANDS = commands(cli)
OPTIONS = set().union(*(options(command) for command in COMMANDS.values())) | FOREIGN


def unknown(piece: str) -> list[str]:
    """What a piece of code names that the program does not have."""
    wrong = []
    for call in re.split(r"(?<!from )(?<![\w.-])slopewatch(?= )", piece)[1:]:
        words = call.split()
        name = " ".join(words[:2]) if " ".join(words[:2]) in COMMANDS else words[0]
        if name not in COMMANDS:
            wrong += [f"slopewatch {name}"] if re.fullmatch(r"[a-z][a-z0-9]*", name) else []
            continue
        given = re.findall(r"(?<!\S)--[a-z][a-z0-9-]*", call.split("||")[0].split("|")[0])
        wrong += [f"slopewatch {name} {option}" for option in given if option not in options(COMMANDS[name])]
    if not re.search(r"\bslopewatch ", piece) and re.match(r"(--[a-z]|[a-z0-9_]+ --[a-z])", piece):
        wrong += [option for option in re.findall(r"(?<!\S)--[a-z][a-z0-9-]*", piece) if option not in OPTIONS]
    return wrong


def unknown_modules(piece: str) -> list[str]:
    """Modules that cannot be started, and benchmarks that do not exist."""
    wrong = []
    for module, rest in re.findall(r"-m (slopewatch(?:\.\w+)*)((?: [a-z]\w*)*)", piece):
        spec = importlib.util.find_spec(module)
        package = spec is not None and spec.submodule_search_locations is not None
        if spec is None or (package and importlib.util.find_spec(f"{module}.__main__") is None):
            wrong.append(module)
        elif module == "slopewatch.lab":
            wrong += [name for name in rest.split() if name not in (*NAMES, *BENCHMARKS_WITH_OPTIONS)]
    return wrong


def missing_files(text: str) -> list[str]:
    """Files and folders of the repository that code spans name and that are not there."""
    named = re.findall(rf"`((?:{'|'.join(FOLDERS)})(?:/[\w.*-]+)*/?)`", text)
    return [name for name in named if "NAME" not in name and not any(ROOT.glob(name.rstrip("/")))]


def reached(starts: list[Path]) -> set[Path]:
    """Pages that links lead to from these, over other pages too."""
    seen: set[Path] = set()
    todo = list(starts)
    while todo:
        page = todo.pop()
        if page in seen or page.suffix != ".md" or not page.is_file():
            continue
        seen.add(page)
        text = page.read_text(encoding="utf-8")
        todo += [(page.parent / target.partition("#")[0]).resolve() for target in links(text) if target[0] != "#"]
    return seen


def not_used() -> dict[str, str]:
    """The words that the glossary keeps out, and what is written for each."""
    table = GLOSSARY.read_text(encoding="utf-8").partition("## Words that are not used")[2]
    return dict(re.findall(r"^\| `(\w+)` \| (.+) \|$", table, flags=re.M))


BANNED = not_used()


def banned(text: str) -> list[str]:
    return re.findall(rf"\b(?:{'|'.join(BANNED)})\b", without_code(text), flags=re.I)


def test_there_are_documents():
    assert len(DOCUMENTS) > 60
    assert sum(len(links(path.read_text(encoding="utf-8"))) for path in DOCUMENTS) > 150


def test_lines_fit():
    assert faults([*DOCUMENTS, CHANGELOG], lambda path: too_long(text_of(path))) == {}


def test_links_lead_somewhere():
    assert faults([*DOCUMENTS, CHANGELOG], broken_links) == {}


def test_pictures_are_shown_and_small():
    pictures = sorted((ROOT / "docs" / "images").iterdir())
    shown = " ".join(path.read_text(encoding="utf-8") for path in DOCUMENTS)
    assert [p.name for p in pictures if f"images/{p.name}" not in shown] == []
    assert [p.name for p in pictures if p.stat().st_size > LARGEST_PICTURE_BYTES] == []


def test_commands_and_options_exist():
    assert faults(DOCUMENTS, lambda path: (n for piece in code(text_of(path)) for n in unknown(piece))) == {}


def test_modules_that_are_started_exist():
    assert faults(DOCUMENTS, lambda path: (n for piece in code(text_of(path)) for n in unknown_modules(piece))) == {}


def test_files_that_are_named_exist():
    assert faults(DOCUMENTS, lambda path: missing_files(text_of(path))) == {}


def test_every_page_is_reached():
    assert sorted(set(DOCS) - reached(STARTS)) == []


def test_words_of_the_glossary():
    assert faults(DOCUMENTS, lambda path: banned(text_of(path))) == {}


@pytest.mark.parametrize(
    "columns",
    [fields.FIELDS, screened_zones.FIELDS, confirmation.FIELDS, ZONE_FIELDS, SERIES_FIELDS, objects.FIELDS],
    ids=["zones", "screened zones", "confirmation", "zones of a series", "series", "objects"],
)
def test_the_guide_explains_every_column(columns):
    guide = (ROOT / "docs" / "guide.md").read_text(encoding="utf-8")
    assert [name for name in columns if f"`{name}`" not in guide] == []


@pytest.mark.parametrize(
    ("page", "files"),
    [
        ("README.md", (*CHANGE_OUTPUTS, *ON_REQUEST, *SCREENING_OUTPUTS, *MOTION_FILES)),
        ("docs/guide.md", SERIES_OUTPUTS),
    ],
)
def test_every_output_is_named(page, files):
    text = (ROOT / page).read_text(encoding="utf-8")
    assert [name for name in files if f"`{name}" not in text] == []


def test_the_glossary_keeps_words_out():
    assert {"told", "beside"} <= set(BANNED)


def test_faults_are_seen(tmp_path):
    page = tmp_path / "page.md"
    page.write_text("# A *b*, c\n\n[a](#a-b-c) [b](#a-b) [c](gone.md) [d](page.md#a-b-c)\n", encoding="utf-8")
    assert broken_links(page) == ["#a-b", "gone.md"]
    assert too_long("x" * 141 + "\n" + "x" * 140) == ["x" * 141]
    assert banned("It told us. `told`\n\n    beside\n\nBesides, beside it.") == ["told", "beside"]
    text = (
        "`slopewatch screen A --any-density` `slopewatch scren A`\n\n    slopewatch simulate survey \\\n  --no-such 1\n"
    )
    assert [name for piece in code(text) for name in unknown(piece)] == [
        "slopewatch simulate survey --no-such",
        "slopewatch scren",
    ]
    assert unknown("--accept-unstable") == []
    assert unknown("--accept-unstables") == ["--accept-unstables"]
    assert unknown_modules(".venv/bin/python -m slopewatch.lab strips stripes") == ["stripes"]
    assert unknown_modules("python -m slopewatch.engine") == ["slopewatch.engine"]
    assert missing_files("`engine/core/errors.py` `engine/core/gone.py` `workflows/` `cli/NAME.py`") == [
        "engine/core/gone.py"
    ]
    assert reached([page]) == {page}
