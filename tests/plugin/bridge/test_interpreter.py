"""Finding the engine's interpreter: order, links, and what is said when there is none."""

from __future__ import annotations

from pathlib import Path

import pytest
from slopewatch.plugin.bridge.interpreter import InterpreterNotFoundError, child_environment, find_interpreter
from slopewatch.plugin.bridge.setup import state


def _interpreter(path: Path) -> Path:
    path.parent.mkdir(parents=True)
    path.write_text("")
    return path


def test_variable_then_setting_then_own_environment(tmp_path: Path) -> None:
    named = _interpreter(tmp_path / "a" / "python")
    other = _interpreter(tmp_path / "b" / "python")
    own = _interpreter(tmp_path / "plugin" / ".venv" / "bin" / "python")
    folder = tmp_path / "plugin"
    assert find_interpreter(str(other), folder, {"SLOPEWATCH_PYTHON": str(named)})[0] == named
    assert find_interpreter(str(other), folder, {})[0] == other
    assert find_interpreter("", folder, {})[0] == own


def test_a_linked_plugin_folder_is_resolved_but_not_the_interpreter(tmp_path: Path) -> None:
    system = _interpreter(tmp_path / "usr" / "python3")
    own = tmp_path / "checkout" / ".venv" / "bin" / "python"
    own.parent.mkdir(parents=True)
    own.symlink_to(system)
    link = tmp_path / "profile" / "slopewatch"
    link.parent.mkdir()
    link.symlink_to(tmp_path / "checkout")
    assert find_interpreter("", link, {})[0] == own


def test_windows_environment_is_found(tmp_path: Path) -> None:
    own = _interpreter(tmp_path / ".venv" / "Scripts" / "python.exe")
    assert find_interpreter("", tmp_path, {})[0] == own


def test_a_named_interpreter_that_is_missing_is_not_replaced(tmp_path: Path) -> None:
    _interpreter(tmp_path / ".venv" / "bin" / "python")
    with pytest.raises(InterpreterNotFoundError, match=r"SLOPEWATCH_PYTHON.*does not exist"):
        find_interpreter("", tmp_path, {"SLOPEWATCH_PYTHON": "/nowhere/python"})
    with pytest.raises(InterpreterNotFoundError, match=r"setting.*does not exist"):
        find_interpreter("/nowhere/python", tmp_path, {})


@pytest.mark.parametrize("data", [None, "data"])
def test_without_any_the_message_names_the_remedy(tmp_path: Path, data: str | None) -> None:
    with pytest.raises(InterpreterNotFoundError, match=r"engine is missing; set it up .*slopewatch:setupengine"):
        find_interpreter("", tmp_path, {}, None if data is None else tmp_path / data)


def test_what_the_set_up_built_comes_last(tmp_path: Path) -> None:
    built = _interpreter(tmp_path / "data" / "environment-abc123" / "bin" / "python")
    state.write(tmp_path / "data", state.State("environment-abc123", "", "1.0", "3.12.1", "python3"))
    assert find_interpreter("", tmp_path, {}, tmp_path / "data") == (built, "the set-up")
    own = _interpreter(tmp_path / ".venv" / "bin" / "python")
    assert find_interpreter("", tmp_path, {}, tmp_path / "data")[0] == own


def test_a_built_one_that_is_gone_is_said(tmp_path: Path) -> None:
    state.write(tmp_path, state.State("environment-abc123", "", "1.0", "3.12.1", "python3"))
    with pytest.raises(InterpreterNotFoundError, match=r"not whole any more .*setupengine"):
        find_interpreter("", tmp_path / "plugin", {}, tmp_path)


def test_environment_is_cleaned() -> None:
    cleaned = child_environment({"PYTHONHOME": "x", "DYLD_INSERT_LIBRARIES": "x", "Path": "p", "virtual_env": "x"})
    assert set(cleaned) == {"Path", "PYTHONUTF8", "PYTHONUNBUFFERED", "PYTHONSAFEPATH", "SLOPEWATCH_FOLDER"}
