"""Two worlds, one rule: what runs inside QGIS and what runs in the engine import nothing of each other."""

from __future__ import annotations

import ast
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
QGIS_WORLD = sorted([*ROOT.glob("plugin/**/*.py"), *ROOT.glob("processing_algorithms/**/*.py"), ROOT / "__init__.py"])
ENGINE_WORLD = sorted(
    p
    for f in ("interface", "engine", "models", "simulation", "workflows", "cli", "api", "library", "benchmarks")
    for p in ROOT.glob(f"{f}/**/*.py")
)
SHARED = sorted((ROOT / "interface").glob("**/*.py"))


def imports(path: Path) -> Iterator[str]:
    """What a file imports, anywhere in it; relative ones as slopewatch.folder.module."""
    package = ("slopewatch", *path.relative_to(ROOT).parent.parts)
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"), str(path))):
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


@pytest.mark.parametrize("path", QGIS_WORLD, ids=lambda p: str(p.relative_to(ROOT)))
def test_the_qgis_world_imports_qgis_the_standard_library_and_the_interface(path: Path) -> None:
    # the public API and the library are loaded on first use only, which is never in QGIS
    late = {".api", ".library"} if path == ROOT / "__init__.py" else set()
    assert [name for name in imports(path) if name not in late and not allowed_in_qgis(name)] == []


@pytest.mark.parametrize("path", ENGINE_WORLD, ids=lambda p: str(p.relative_to(ROOT)))
def test_the_engine_world_imports_no_qgis(path: Path) -> None:
    refused = ("qgis", "PyQt5", "PyQt6", "osgeo", "slopewatch.plugin", "slopewatch.processing_algorithms")
    assert [n for n in imports(path) if n.startswith(refused)] == []


@pytest.mark.parametrize("path", SHARED, ids=lambda p: str(p.relative_to(ROOT)))
def test_the_interface_imports_itself_and_the_standard_library_only(path: Path) -> None:
    own = "slopewatch.interface."
    assert [
        n for n in imports(path) if not n.startswith(own) and n.partition(".")[0] not in sys.stdlib_module_names
    ] == []


@pytest.mark.parametrize("path", [*QGIS_WORLD, *SHARED], ids=lambda p: str(p.relative_to(ROOT)))
def test_the_qgis_world_is_python_3_9(path: Path) -> None:
    tree = ast.parse(path.read_text(encoding="utf-8"), feature_version=(3, 9))
    lazy = any(
        isinstance(n, ast.ImportFrom) and n.module == "__future__" and n.names[0].name == "annotations"
        for n in tree.body
    )
    assert lazy or not any(
        isinstance(n, ast.AnnAssign | ast.arg) and getattr(n, "annotation", None) for n in ast.walk(tree)
    )
    for node in ast.walk(tree):
        assert not isinstance(node, ast.Match | ast.TryStar)
        if isinstance(node, ast.Call):
            assert not any(k.arg in ("strict", "slots", "kw_only") for k in node.keywords), f"line {node.lineno}"


@pytest.mark.parametrize("path", [*QGIS_WORLD, *ENGINE_WORLD], ids=lambda p: str(p.relative_to(ROOT)))
def test_nothing_that_the_plugin_repository_refuses(path: Path) -> None:
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Call):
            called = ast.unparse(node.func)
            assert called not in ("exec", "eval", "compile"), f"line {node.lineno}"
            assert not called.endswith(("yaml.load", "tarfile.extractall", "os.system", "os.popen")), (
                f"line {node.lineno}"
            )
            for keyword in node.keywords:
                shell = keyword.arg == "shell" and not (
                    isinstance(keyword.value, ast.Constant) and keyword.value.value is False
                )
                assert not shell, f"line {node.lineno}"
    assert not [n for n in imports(path) if n.partition(".")[0] in ("pickle", "cPickle", "marshal", "shelve", "dill")]


def test_the_rule_sees_a_breach(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys.modules[__name__], "ROOT", tmp_path)
    (tmp_path / "plugin").mkdir()
    breach = tmp_path / "plugin" / "breach.py"
    breach.write_text(
        "def f():\n    import numpy\n    from ..engine import change\n    from ..interface.parameters import PROFILES\n"
    )
    assert [n for n in imports(breach) if not allowed_in_qgis(n)] == ["numpy", "slopewatch.engine.change"]


SETUP = sorted((ROOT / "plugin" / "bridge" / "setup").glob("*.py"))


@pytest.mark.parametrize("path", SETUP, ids=lambda p: p.name)
def test_the_set_up_needs_no_qgis(path: Path) -> None:
    """So that it can be tested, and run, on any system."""
    own = ("slopewatch.plugin.bridge.setup", "slopewatch.interface.")
    found = [n for n in imports(path) if not n.startswith(own) and n.partition(".")[0] not in sys.stdlib_module_names]
    assert found == []
