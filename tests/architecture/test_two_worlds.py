"""Two worlds, one rule: what runs inside QGIS and what runs in the engine import nothing of each other."""

from __future__ import annotations

import ast
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from slopewatch.tests.builders.walk import ROOT, faults, nodes_in, text_of

QGIS_WORLD = sorted([*ROOT.glob("plugin/**/*.py"), *ROOT.glob("processing_algorithms/**/*.py"), ROOT / "__init__.py"])
ENGINE_WORLD = sorted(
    p
    for f in ("interface", "engine", "models", "simulation", "workflows", "cli", "api", "library", "lab")
    for p in ROOT.glob(f"{f}/**/*.py")
    if "sessions" not in p.parts  # of the laboratory: they drive QGIS
)
SHARED = sorted((ROOT / "interface").glob("**/*.py"))


def imports(path: Path) -> Iterator[str]:
    """What a file imports, anywhere in it; relative ones as slopewatch.folder.module."""
    package = ("slopewatch", *path.relative_to(ROOT).parent.parts)
    for node in nodes_in(text_of(path)):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            base = ".".join(package[: len(package) - node.level + 1]) if node.level else ""
            module = ".".join(part for part in (base, node.module) if part)
            yield from (f"{module}.{alias.name}" for alias in node.names)
        elif isinstance(node, ast.Call) and isinstance(node.func, ast.Name | ast.Attribute):
            name = node.func.id if isinstance(node.func, ast.Name) else node.func.attr
            if name in ("__import__", "import_module"):
                argument = node.args[0] if node.args else None
                yield argument.value if isinstance(argument, ast.Constant) else "an import by computed name"


def allowed_in_qgis(name: str) -> bool:
    top = name.partition(".")[0]
    if top == "slopewatch":
        return name.startswith(("slopewatch.plugin", "slopewatch.processing_algorithms", "slopewatch.interface."))
    return top in ("qgis", "processing") or top in sys.stdlib_module_names  # processing comes with QGIS


def beyond(path: Path, *own: str) -> list[str]:
    """Imports of a file that are neither the standard library nor begin with one of ``own``."""
    return [n for n in imports(path) if not n.startswith(own) and n.partition(".")[0] not in sys.stdlib_module_names]


def test_the_qgis_world_imports_qgis_the_standard_library_and_the_interface() -> None:
    late = {ROOT / "__init__.py": {".api", ".library"}}  # loaded on first use only, which is never in QGIS
    assert (
        faults(QGIS_WORLD, lambda p: (n for n in imports(p) if n not in late.get(p, ()) and not allowed_in_qgis(n)))
        == {}
    )


def test_the_engine_world_imports_no_qgis() -> None:
    refused = ("qgis", "PyQt5", "PyQt6", "osgeo", "slopewatch.plugin", "slopewatch.processing_algorithms")
    assert faults(ENGINE_WORLD, lambda path: (n for n in imports(path) if n.startswith(refused))) == {}


def test_the_interface_imports_itself_and_the_standard_library_only() -> None:
    assert faults(SHARED, lambda path: beyond(path, "slopewatch.interface.")) == {}


def newer_than_3_9(path: Path) -> Iterator[str]:
    """What Python 3.9 does not know."""
    tree = ast.parse(text_of(path), feature_version=(3, 9))
    lazy = any(
        isinstance(n, ast.ImportFrom) and n.module == "__future__" and n.names[0].name == "annotations"
        for n in tree.body
    )
    for node in ast.walk(tree):
        if not lazy and isinstance(node, ast.AnnAssign | ast.arg) and getattr(node, "annotation", None):
            yield "annotations without the future import"
        if isinstance(node, ast.Match | ast.TryStar):
            yield f"line {node.lineno}: a statement"
        if isinstance(node, ast.Call) and any(k.arg in ("strict", "slots", "kw_only") for k in node.keywords):
            yield f"line {node.lineno}: an argument"


def test_the_qgis_world_is_python_3_9() -> None:
    assert faults([*QGIS_WORLD, *SHARED], newer_than_3_9) == {}


def refused_by_the_repository(path: Path) -> Iterator[str]:
    """What QGIS's plugin repository takes for a danger."""
    for node in nodes_in(text_of(path)):
        if not isinstance(node, ast.Call):
            continue
        called = ast.unparse(node.func)
        shells = [k.value for k in node.keywords if k.arg == "shell"]
        shell = any(not (isinstance(value, ast.Constant) and value.value is False) for value in shells)
        dangerous = called.endswith(("yaml.load", "tarfile.extractall", "os.system", "os.popen"))
        if shell or dangerous or called in ("exec", "eval", "compile"):
            yield f"line {node.lineno}: {called}"
    yield from (n for n in imports(path) if n.partition(".")[0] in ("pickle", "cPickle", "marshal", "shelve", "dill"))


def test_nothing_that_the_plugin_repository_refuses() -> None:
    assert faults([*QGIS_WORLD, *ENGINE_WORLD], refused_by_the_repository) == {}


def test_the_rule_sees_a_breach(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys.modules[__name__], "ROOT", tmp_path)
    (tmp_path / "plugin").mkdir()
    breach = tmp_path / "plugin" / "breach.py"
    breach.write_text(
        "def f():\n    import numpy\n    from ..engine import change\n    from ..interface.parameters import PROFILES\n"
    )
    assert [n for n in imports(breach) if not allowed_in_qgis(n)] == ["numpy", "slopewatch.engine.change"]
    breach.write_text("def f(x: int):\n    eval(x)\n    zip(x, strict=True)\n    run(shell=x)\n    import pickle\n")
    text_of.cache_clear()
    assert len(list(refused_by_the_repository(breach))) == 3
    assert len(list(newer_than_3_9(breach))) == 2


SETUP = sorted((ROOT / "plugin" / "bridge" / "setup").glob("*.py"))


def test_the_set_up_needs_no_qgis() -> None:
    """So that it can be tested, and run, on any system."""
    assert faults(SETUP, lambda path: beyond(path, "slopewatch.plugin.bridge.setup", "slopewatch.interface.")) == {}
