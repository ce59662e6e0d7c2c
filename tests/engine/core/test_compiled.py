"""Kernels: compiled where numba is, plain where it is not or nothing can be kept; without numba when none is called."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

MODULE = """
import sys
import numpy as np
from slopewatch.engine.core.compiled import compiled

def plain(values):
    return values.sum() + 1000.0

@compiled(plain)
def total(values):
    found = 0.0
    for i in range(len(values)):
        found += values[i]
    return found

if __name__ == "__main__":
    assert "numba" not in sys.modules, "imported before a kernel was called"
    print(float(total(np.arange(4.0))))
"""


def _answer(path: Path, **environment: str) -> float:
    done = subprocess.run(
        [sys.executable, str(path)],
        env=os.environ | {"NUMBA_DISABLE_JIT": "0"} | environment,
        check=True,
        capture_output=True,
        text=True,
    )
    return float(done.stdout)


@pytest.fixture
def module(tmp_path: Path) -> Path:
    path = tmp_path / "kernels.py"
    path.write_text(MODULE, encoding="utf-8")
    return path


def test_a_kernel_is_compiled_and_kept(module: Path, tmp_path: Path) -> None:
    pytest.importorskip("numba")
    cache = tmp_path / "cache"
    assert _answer(module, NUMBA_CACHE_DIR=str(cache)) == 6.0
    assert list(cache.rglob("*.nbc")), "nothing was kept"


def test_the_plain_way_is_taken_without_numba(module: Path, tmp_path: Path) -> None:
    none = tmp_path / "without"
    none.mkdir()
    (none / "numba.py").write_text("raise ImportError('none here')", encoding="utf-8")
    path = os.pathsep.join([str(none), *filter(None, [os.environ.get("PYTHONPATH")])])
    assert _answer(module, PYTHONPATH=path) == 1006.0


def test_the_plain_way_is_taken_when_asked_for(module: Path) -> None:
    assert _answer(module, NUMBA_DISABLE_JIT="1") == 1006.0


def test_the_plain_way_is_taken_where_nothing_can_be_kept(module: Path) -> None:
    """No folder can be made where a file lies, not even by root, who may write into read-only ones."""
    pytest.importorskip("numba")
    (module.parent / "__pycache__").write_text("a file", encoding="utf-8")
    (module.parent / "home").write_text("a file", encoding="utf-8")
    home = str(module.parent / "home")
    assert _answer(module, HOME=home, XDG_CACHE_HOME=home, LOCALAPPDATA=home) == 1006.0


def test_the_user_cache_is_taken_where_the_module_lies_in_a_folder_without_one(module: Path) -> None:
    pytest.importorskip("numba")
    (module.parent / "__pycache__").write_text("a file", encoding="utf-8")
    home = module.parent / "home"
    home.mkdir()
    assert _answer(module, HOME=str(home), XDG_CACHE_HOME=str(home), LOCALAPPDATA=str(home)) == 6.0
    assert list(home.rglob("*.nbc")), "nothing was kept"


HELPED = """
import sys
import numpy as np
from slopewatch.engine.core.compiled import compiled, pays, take_kernels

def plain(values):
    return values.sum() + 1000.0

def square(value):
    return value * value

def fourth(value):
    return square(value) * square(value)

@compiled(plain, square, fourth)
def total(values):
    found = 0.0
    for i in range(len(values)):
        found += fourth(values[i])
    return found

if __name__ == "__main__":
    assert not pays(9, 10), "numba is not loaded for little work"
    before = pays(10, 10)
    result = float(total(np.arange(3.0)))
    assert pays(9, 10) == before, "and pays for any once it is"
    print(result)
"""


def test_a_kernel_calls_its_helpers_and_then_any_work_pays(module: Path) -> None:
    pytest.importorskip("numba")
    module.write_text(HELPED, encoding="utf-8")
    assert _answer(module) == 17.0


def test_nothing_pays_where_kernels_are_refused(module: Path) -> None:
    module.write_text(HELPED, encoding="utf-8")
    assert _answer(module, NUMBA_DISABLE_JIT="1") == 1003.0
