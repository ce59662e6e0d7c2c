"""The tutorial names what the plugin has, and shows the pictures that its session takes."""

from __future__ import annotations

import ast
import re
from pathlib import Path
from typing import Any

import pytest
from slopewatch.lab.sessions.screenshots import not_on_the_page
from slopewatch.plugin.slopewatch_plugin import MENU

ROOT = Path(__file__).resolve().parents[2]
PAGE = ROOT / "docs" / "tutorial.md"
SESSION = ROOT / "lab" / "sessions" / "tutorial_session.py"
OF_QGIS = {"Plugins", "Manage and Install Plugins", "Install from ZIP", "Project", "Save", "Run", "Close", "Log"} | {
    "Layer", "Add Layer", "Add Raster Layer…", "Processing Toolbox", "Results Viewer", "…", "Layers", "New",
}  # fmt: skip
EMPHASISED = {"significant"}


def named(text: str) -> list[list[str]]:
    """What a page has in italics; of a path, its parts."""
    plain = re.sub(r"^```.*?^```", "", text, flags=re.S | re.M)
    found = re.findall(r"(?<![*\w])\*([^*\s](?:[^*]*[^*\s])?)\*(?![*\w])", plain)
    return [" ".join(words.split()).split(" → ") for words in found]


def words_of(folder: str) -> set[str]:
    """The string constants of the modules of a folder."""
    trees = [ast.parse(path.read_text(encoding="utf-8")) for path in sorted((ROOT / folder).rglob("*.py"))]
    nodes = [node for tree in trees for node in ast.walk(tree)]
    return {node.value for node in nodes if isinstance(node, ast.Constant) and isinstance(node.value, str)}


def labels(provider: Any) -> set[str]:
    """Titles and groups of the toolbox, labels of all fields and results."""
    algorithms = provider.algorithms()
    titles = {word for a in algorithms for word in (a.displayName(), a.group())}
    fields = {d.description() for a in algorithms for d in (*a.parameterDefinitions(), *a.outputDefinitions())}
    return titles | fields


def unknown(names: list[list[str]], provider: Any) -> list[str]:
    """Those of the names that neither the plugin nor QGIS has; a path into the menu must lead somewhere."""
    known = labels(provider) | words_of("plugin") | words_of("processing_algorithms") | words_of("engine/maps")
    menu = {(a.group(), f"{a.displayName()}…") for a in provider.algorithms()}
    menu |= {(word,) for word in ("Panel", "Set up engine…", "Settings…", "Help") if word in words_of("plugin")}
    wrong = []
    for parts in names:
        if parts[:2] == ["Plugins", MENU]:
            fine = not parts[2:] or tuple(parts[2:]) in menu
        else:
            fine = all(part in known | OF_QGIS | EMPHASISED for part in parts)
        if not fine:
            wrong.append(" → ".join(parts))
    return wrong


def pictures_of_the_session() -> set[str]:
    return set(re.findall(r'"(tutorial_\d_\w+)"', SESSION.read_text(encoding="utf-8")))


def test_everything_named_is_in_the_plugin(provider: Any) -> None:
    names = named(PAGE.read_text(encoding="utf-8"))
    assert len(names) > 40
    assert unknown(names, provider) == []


def test_the_ten_fields_of_the_inspection_are_explained_in_their_order(provider: Any) -> None:
    algorithm = provider.algorithm("inspectslope")
    advanced = [d for d in algorithm.parameterDefinitions() if not d.isDestination()]
    fields = [d.description() for d in advanced if not int(d.flags()) & int(d.Flag.FlagAdvanced)]
    table = re.findall(r"^\| \*([^*|]+)\* \| [^*]", PAGE.read_text(encoding="utf-8"), flags=re.M)
    assert len(fields) == 10
    assert table == fields


def test_its_pictures_are_those_that_the_session_takes() -> None:
    shown = re.findall(r"\(images/(\w+)\.png\)", PAGE.read_text(encoding="utf-8"))
    files = {path.stem: path.stat().st_size for path in (ROOT / "docs" / "images").glob("tutorial_*.png")}
    assert {name for name in shown if name.startswith("tutorial_")} == pictures_of_the_session() == set(files)
    assert len(shown) <= 8
    assert max(files.values()) <= 250_000


@pytest.mark.parametrize(
    "text",
    ["*Plugins → SlopeWatch → Tools → Simulate survey…*", "*Plugins → SlopeWatch → Steps*", "*Points an epoch*"],
)
def test_a_wrong_name_is_seen(provider: Any, text: str) -> None:
    right = "**Bold**, 2 * 3 * 4, *Plugins → SlopeWatch → Tools → Simulate a\nsurvey…*, *Points per epoch*"
    assert unknown(named(right), provider) == []
    assert unknown(named(f"{right} and {text}."), provider) == [text.strip("*")]


def test_figures_of_another_run_are_seen() -> None:
    report = {
        "logs": {"inspectslope": "Reading\n4 zones of significant change, 98 m² in all.\n"},
        "zones": [["Z001", "uplift", "moderate", "+0.145", "31.6"]],
    }
    page = "> 4 zones of significant\n> change, 98 m² in all.\n\n| Z001 | uplift | moderate | +0.145 | 31.6 |\n"
    assert not_on_the_page(report, page) == []
    assert not_on_the_page(report, page.replace("98", "99").replace("31.6", "31.7")) == [
        "4 zones of significant change, 98 m² in all.",
        "| Z001 | uplift | moderate | +0.145 | 31.6 |",
    ]
