"""Where the program of QGIS is looked for, and what is done where there is none."""

from __future__ import annotations

import os
import stat
from pathlib import Path

import pytest
from slopewatch.engine.core.errors import EngineError, InputError
from slopewatch.engine.core.qgis_program import VARIABLE, find_qgis_process, run_algorithm


def program(path: Path, body: str) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(f"#!/bin/sh\n{body}\n", encoding="utf-8")
    path.chmod(path.stat().st_mode | stat.S_IXUSR)
    return path


def test_it_is_found_where_the_variable_says_then_on_the_path(tmp_path: Path) -> None:
    named = program(tmp_path / "a" / "bin" / "qgis_process", "")
    on_path = program(tmp_path / "b" / "qgis_process", "")
    path = {"PATH": str(on_path.parent)}
    assert find_qgis_process({**path, VARIABLE: str(tmp_path / "a")}) == named
    assert find_qgis_process({**path, VARIABLE: str(named)}) == named
    assert find_qgis_process(path) == on_path


@pytest.mark.parametrize(("variable", "words"), [("/nowhere", "names /nowhere, where no"), ("", "install QGIS 3.34")])
def test_without_one_the_sentence_says_how_to_get_it(variable: str, words: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=words):
        find_qgis_process({"PATH": str(tmp_path), VARIABLE: variable})


@pytest.mark.skipif(os.name != "posix", reason="the stand-in is a script of the shell")
def test_what_it_says_is_its_result_or_its_refusal(tmp_path: Path) -> None:
    said = tmp_path / "said"
    body = f"""echo "$QGIS_PLUGINPATH" >> {said}
case "$*" in
  plugins*) test -e "$QGIS_PLUGINPATH/slopewatch/metadata.txt" ;;
  *no*) echo "----" >&2; echo "It is not good." >&2; exit 1 ;;
  *crash*) exit 134 ;;
  *) echo '{{"results": {{"LAYERS": 3}}}}' ;;
esac"""
    found = program(tmp_path / "qgis_process", body)
    environ = {"PATH": os.environ["PATH"], "PYTHONHOME": "/wrong"}
    assert run_algorithm(found, "createproject", {"INPUT": "a"}, environ) == {"LAYERS": 3}
    with pytest.raises(InputError, match=r"^It is not good\.$"):
        run_algorithm(found, "createproject", {"INPUT": "no"}, environ)
    with pytest.raises(EngineError, match="ended with code 134"):
        run_algorithm(found, "createproject", {"INPUT": "crash"}, environ)
    folders = set(said.read_text(encoding="utf-8").split())
    assert folders
    assert not any(Path(folder).exists() for folder in folders), "its profile is gone"
