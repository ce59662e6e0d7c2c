"""Which Pythons are tried on each system: never QGIS itself, first what QGIS came with."""

from __future__ import annotations

import json
from collections.abc import Sequence

import pytest
from slopewatch.plugin.bridge.setup.pythons import Running, candidates, in_order, none_found, probe

WINDOWS = Running("win32", r"C:\OSGeo4W\bin\qgis-ltr-bin.exe", r"C:\OSGeo4W\apps\Python312", (3, 12))
MACOS = Running(
    "darwin",
    "/Applications/QGIS.app/Contents/MacOS/QGIS",
    "/Applications/QGIS.app/Contents/Frameworks",
    (3, 12),
)


def tried(running: Running, files: Sequence[str], **environ: str) -> list[str]:
    return [" ".join(command) for command, _ in candidates(running, environ, set(files).__contains__)]


def test_on_windows_the_python_of_osgeo4w_not_qgis() -> None:
    own = r"C:\OSGeo4W\apps\Python312\python.exe"
    assert tried(WINDOWS, [own, WINDOWS.executable]) == [own]


def test_on_windows_a_qgis_of_the_installer() -> None:
    own = r"C:\Program Files\QGIS 3.40.6\apps\Python312\python.exe"
    running = Running("win32", r"C:\Program Files\QGIS 3.40.6\bin\qgis-bin.exe", "C:\\nowhere", (3, 12))
    assert tried(running, [own]) == [own]


def test_on_windows_further_ones_in_order() -> None:
    files = [
        r"C:\Windows\py.exe",
        r"D:\Python\python.exe",
        r"C:\Users\Ana\AppData\Local\Microsoft\WindowsApps\python.exe",
        r"C:\Users\Ana\AppData\Local\Programs\Python\Python311\python.exe",
        r"C:\conda\python.exe",
    ]
    path = r"C:\Users\Ana\AppData\Local\Microsoft\WindowsApps;D:\Python;"
    local = r"C:\Users\Ana\AppData\Local"
    found = tried(WINDOWS, files, PATH=path, LOCALAPPDATA=local, CONDA_PREFIX=r"C:\conda")
    assert found[:3] == [files[1], files[4], files[3]]
    assert found[3:] == [rf"C:\Windows\py.exe -3.{minor}" for minor in (12, 11, 10, 13, 14)]


@pytest.mark.parametrize(
    "own",
    [
        "/Applications/QGIS.app/Contents/MacOS/bin/python3",
        "/Applications/QGIS.app/Contents/MacOS/python3.12",
        "/Applications/QGIS.app/Contents/Frameworks/bin/python3.12",
        "/Applications/QGIS.app/Contents/Frameworks/Python.framework/Versions/3.12/bin/python3",
    ],
)
def test_on_macos_the_bundles_python_first(own: str) -> None:
    framework = "/Library/Frameworks/Python.framework/Versions/3.11/bin/python3.11"
    files = ["/opt/homebrew/bin/python3.12", own, framework, "/usr/bin/python3", MACOS.executable]
    assert tried(MACOS, files, PATH="/usr/bin:/bin") == [own, "/usr/bin/python3", files[0], framework]


def test_on_linux_the_one_that_runs_then_the_path() -> None:
    running = Running("linux", "/usr/bin/python3", "/usr", (3, 13))
    files = ["/usr/bin/python3", "/usr/bin/python3.13", "/home/a/bin/python3.12"]
    assert tried(running, files, PATH="/home/a/bin:relative:/usr/bin") == [
        "/usr/bin/python3",
        "/usr/bin/python3.13",
        "/home/a/bin/python3.12",
    ]


def test_on_linux_a_program_with_qgis_in_it_is_not_started() -> None:
    running = Running("linux", "/opt/qgis/bin/qgis", "/opt/qgis", (3, 12))
    assert tried(running, ["/opt/qgis/bin/qgis", "/opt/qgis/bin/python3.12"]) == ["/opt/qgis/bin/python3.12"]


def answer(version: str = "3.12.4", bits: int = 64, venv: bool = True, executable: str = "/p/python") -> str:
    return "noise of a site\n" + json.dumps(
        {"version": version, "bits": bits, "venv": venv, "executable": executable, "tag": "cpython-312-linux-x86_64"}
    )


@pytest.mark.parametrize(
    ("said", "why"),
    [
        (answer(version="3.8.18"), r"^Python 3\.8\.18 at python is too old$"),
        (answer(bits=32), "32 bits"),
        (answer(venv=False), "no module venv"),
        ("QGIS 3.40", "^python does not start$"),
        ("", "does not start"),
    ],
)
def test_a_python_that_cannot_be_used_is_refused(said: str, why: str) -> None:
    with pytest.raises(ValueError, match=why):
        probe(["python"], "PATH", lambda command: said)


def test_those_with_all_builds_come_first_and_each_is_asked_in_its_turn() -> None:
    answers = {
        "old": answer("3.9.1", executable="/old"),
        "new": answer("3.15.1", executable="/new"),
        "good": answer("3.11.2", executable="/good"),
        "same": answer("3.11.2", executable="/good"),
        "last": answer("3.10.0", executable="/last"),
    }
    asked: list[str] = []

    def ask(command: Sequence[str]) -> str:
        asked.append(command[0])
        return answers[command[0]]

    refused: list[str] = []
    found = in_order([((name,), "x") for name in answers], ask, refused)
    assert next(found).executable == "/good"
    assert asked == ["old", "new", "good"]
    assert [one.executable for one in found] == ["/last", "/new"]
    assert refused == ["Python 3.9.1 at old is too old"]


def test_where_there_is_none_it_says_what_to_install() -> None:
    assert str(none_found([])) == (
        "The engine needs Python 3.10 or newer with 64 bits (none was found); install Python 3.12 from "
        "https://www.python.org/downloads/ and set the engine up again."
    )
