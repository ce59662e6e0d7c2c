"""No module opens a file of the user's past the door (``engine/core/input_files``)."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PACKAGES = ("interface", "engine", "models", "workflows", "cli", "api", "library")
READERS = {
    "open", "read_text", "read_bytes", "copyfile", "loadtxt", "genfromtxt", "memmap", "read_csv", "read_file",
    "read_dataframe", "read_arrow", "read_raw", "read_info", "list_layers", "load_file", "safe_open",
    "parse", "ZipFile",
}  # fmt: skip
DOORS = {"readable", "writable", "open_input", "read_input", "check_input", "check_layer", "open_any_grid"}
"""A reader may take a name within a function that goes through one of these first."""
OPENED_BEFORE = {
    "engine/road/centreline.py": "_line_layer", "engine/road/measures.py": "read_measures",
    "engine/vector/area.py": "_polygon_layer", "engine/zones/profile_lines.py": "_line_layer",
    "workflows/batch/manifest_layer.py": "_polygon_layer",
    "models/network/plain_unet.py": "load_plain_unet", "models/network/weights.py": "load_tensors",
}  # fmt: skip
"""Functions that take a file from one that went through a door."""
OWN = {
    "of the system": ("engine/core/child_process.py", "engine/core/machine_memory.py", "cli/options.py"),
    "that come with SlopeWatch": (
        "interface/language/catalogue.py", "engine/maps/picture_words.py", "engine/maps/qgis_styles.py",
        "engine/report/corridor.py", "models/network/shipped.py",
    ),
    "of a run at work, or just written to be checked": (
        "engine/core/journal.py", "engine/core/part_folders.py", "engine/core/temporary_folders.py", "engine/ground/",
        "engine/grid/geotiff.py",
        "engine/handover/drawing.py", "engine/handover/landxml.py", "engine/handover/package.py", "engine/maps/",
        "engine/pointcloud/copc_writing.py", "engine/pointcloud/geotiff_keys.py", "engine/pointcloud/kept_parts.py",
        "engine/pointcloud/point_squares.py", "engine/report/compose.py", "engine/report/signed/typesetting.py",
        "engine/vector/geopackage.py", "models/training/", "workflows/run.py", "workflows/screen.py",
        "workflows/series_store.py", "workflows/batch/dask_cluster.py",
    ),
    "of finished slopes of a batch": (
        "workflows/batch/corridor_plan.py", "workflows/batch/kept_ground.py", "workflows/batch/mosaic.py",
        "workflows/batch/pages.py", "workflows/batch/products.py", "workflows/batch/state.py",
        "workflows/batch/task_ids.py",
    ),
    "of a run that engine/handover/held.py has looked at": (
        "engine/handover/about.py", "engine/handover/stac.py", "engine/handover/tables.py",
        "workflows/handover_formats.py",
    ),
    "a lock": ("interface/file_lock.py",),
    "the door itself": ("interface/input_files.py",),
}  # fmt: skip
"""Modules and folders of modules that open only files of their own."""


def past_the_door(source: str) -> Iterator[tuple[str, int]]:
    """Function and line of each call that may open a file by its name, in a function that goes through no door."""
    if not any(reader in source for reader in READERS):  # parsing takes longer
        return
    tree = ast.parse(source)
    for place, body in _functions(tree, ""):
        calls = [node for node in ast.walk(body) if isinstance(node, ast.Call)]
        if not any(_name(call) in DOORS for call in calls):
            yield from ((place, call.lineno) for call in calls if _name(call) in READERS and not _writes(call))


def _functions(node: ast.AST, place: str) -> Iterator[tuple[str, ast.AST]]:
    for child in ast.iter_child_nodes(node):
        if isinstance(child, (ast.FunctionDef, ast.AsyncFunctionDef)):
            yield f"{place}{child.name}", child
        elif isinstance(child, ast.ClassDef):
            yield from _functions(child, f"{place}{child.name}.")
        elif not isinstance(child, (ast.Import, ast.ImportFrom)):
            yield "", child


def _name(call: ast.Call) -> str:
    return call.func.attr if isinstance(call.func, ast.Attribute) else getattr(call.func, "id", "")


def _writes(call: ast.Call) -> bool:
    modes = [a.value for a in call.args if isinstance(a, ast.Constant) and isinstance(a.value, str)]
    return any(mode[:1] in ("w", "a", "x") and len(mode) <= 3 for mode in modes)


@pytest.mark.parametrize(
    ("source", "count"),
    [
        ("def f(path):\n    return path.read_text()", 1),
        ("class A:\n    def f(self, path):\n        with open(path) as s:\n            pass", 1),
        ("def f(path):\n    path.open('w')", 0),
        ("def f(path):\n    with readable(path) as plain:\n        return read_dataframe(plain)", 0),
        ("TEXT = Path('x').read_bytes()", 1),
    ],
)
def test_what_opens_a_file_is_seen(source: str, count: int):
    assert len(list(past_the_door(source))) == count


def test_nothing_opens_a_users_file_past_the_door():
    own = tuple(place for places in OWN.values() for place in places)
    found, unused = [], set(own)
    for package in PACKAGES:
        for path in sorted((ROOT / package).rglob("*.py")):
            name = path.relative_to(ROOT).as_posix()
            for place, line in past_the_door(path.read_text(encoding="utf-8")):
                unused -= {one for one in own if name.startswith(one)}
                if not name.startswith(own) and OPENED_BEFORE.get(name) != place:
                    found.append(f"{name}, line {line}")
    assert not found, "go through engine/core/input_files"
    assert not unused, "take these off the list"
