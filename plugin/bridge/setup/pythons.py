"""Finds a Python that the engine's environment can be made from: QGIS's own first, then those of the system.

Inside QGIS ``sys.executable`` is often QGIS itself, which would open a second time. What is tried is named by functions
of the system, the environment and the files that exist; nothing is started before ``probe``.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import PurePath, PurePosixPath, PureWindowsPath

from .problems import SetupError

OLDEST = (3, 10)
PREFERRED = ((3, 12), (3, 11), (3, 10), (3, 13), (3, 14))
"""Those for which the packages of the lock have ready builds."""
REMEDY = "install Python 3.12 from https://www.python.org/downloads/ and set the engine up again"
_QUESTION = """
import importlib.util as u, json, platform, struct, sys, sysconfig
print(json.dumps({
    "version": platform.python_version(), "bits": 8 * struct.calcsize("P"),
    "executable": getattr(sys, "_base_executable", "") or sys.executable, "venv": u.find_spec("venv") is not None,
    "tag": sys.implementation.cache_tag + "-" + sysconfig.get_platform(),
}))
"""


@dataclass(frozen=True)
class Running:
    """What the running Python says of itself: ``sys.platform``, ``executable``, ``prefix``, ``version_info``."""

    platform: str
    executable: str
    prefix: str
    version: tuple[int, int]


@dataclass(frozen=True)
class Found:
    """A Python that starts: its program, version "3.12.4", and the tag of the builds that it takes."""

    executable: str
    version: str
    tag: str
    how: str

    @property
    def release(self) -> tuple[int, ...]:
        return tuple(int(part) for part in self.version.split(".")[:2])


def candidates(
    running: Running, environ: Mapping[str, str], is_file: Callable[[str], bool]
) -> list[tuple[tuple[str, ...], str]]:
    """Commands that may start a Python, each with where it was looked for; in order, none twice."""
    places = {"win32": _on_windows, "darwin": _on_macos}.get(running.platform, _on_linux)
    found: dict[tuple[str, ...], str] = {}
    for place, how in places(running, environ):
        if is_file(str(place)):
            found.setdefault((str(place),), how)
    if running.platform == "win32":
        launcher = PureWindowsPath(environ.get("SystemRoot", "C:\\Windows")) / "py.exe"
        if is_file(str(launcher)):
            for major, minor in PREFERRED:
                found.setdefault((str(launcher), f"-{major}.{minor}"), "the py launcher")
    return list(found.items())


Places = Iterator[tuple[PurePath, str]]
QGIS, PATH, CONDA, USUAL = "QGIS's own Python", "the search path", "conda", "the usual folders"


def _on_windows(running: Running, environ: Mapping[str, str]) -> Places:
    prefix, beside = PureWindowsPath(running.prefix), PureWindowsPath(running.executable).parent
    number = "{}{}".format(*running.version)
    yield prefix / "python.exe", QGIS  # OSGeo4W and the installer: PYTHONHOME is apps\Python312
    for root in (beside, *list(beside.parents)[:2]):
        yield root / "apps" / f"Python{number}" / "python.exe", QGIS
        yield root / "python.exe", QGIS
    for folder in environ.get("PATH", "").split(";"):
        if folder and "WindowsApps" not in folder:  # Microsoft's stand-ins open a shop, or keep files elsewhere
            yield PureWindowsPath(folder) / "python.exe", PATH
            yield PureWindowsPath(folder) / "python3.exe", PATH
    if environ.get("CONDA_PREFIX"):
        yield PureWindowsPath(environ["CONDA_PREFIX"]) / "python.exe", CONDA
    local, programs = environ.get("LOCALAPPDATA", ""), environ.get("ProgramFiles", "C:\\Program Files")
    for major, minor in PREFERRED:
        for base in ([PureWindowsPath(local) / "Programs" / "Python"] if local else []) + [PureWindowsPath(programs)]:
            yield base / f"Python{major}{minor}" / "python.exe", USUAL


def _on_macos(running: Running, environ: Mapping[str, str]) -> Places:
    prefix, beside = PurePosixPath(running.prefix), PurePosixPath(running.executable).parent
    number = "{}.{}".format(*running.version)
    contents = beside.parent
    for folder in (
        *(beside, beside / "bin", prefix / "bin", contents / "Frameworks" / "bin"),
        contents / "Frameworks" / "Python.framework" / "Versions" / number / "bin",
        *(prefix / "tools" / "python3", contents / "Resources" / "python" / "bin"),
    ):
        yield folder / f"python{number}", QGIS
        yield folder / "python3", QGIS
    yield from _on_path(environ)
    # programs that the Finder starts have a short search path
    for major, minor in PREFERRED:
        name = f"python{major}.{minor}"
        yield PurePosixPath("/Library/Frameworks/Python.framework/Versions") / f"{major}.{minor}" / "bin" / name, USUAL
        yield PurePosixPath("/opt/homebrew/bin") / name, USUAL
        yield PurePosixPath("/usr/local/bin") / name, USUAL


def _on_linux(running: Running, environ: Mapping[str, str]) -> Places:
    executable = PurePosixPath(running.executable)
    number = "{}.{}".format(*running.version)
    if executable.name.startswith("python"):
        yield executable, QGIS
    yield PurePosixPath(running.prefix) / "bin" / f"python{number}", QGIS
    yield from _on_path(environ)
    yield PurePosixPath("/usr/bin/python3"), USUAL


def _on_path(environ: Mapping[str, str]) -> Places:
    names = ["python3", *(f"python{major}.{minor}" for major, minor in PREFERRED)]
    folders = [PurePosixPath(folder) for folder in environ.get("PATH", "").split(":") if folder.startswith("/")]
    if environ.get("CONDA_PREFIX"):
        yield PurePosixPath(environ["CONDA_PREFIX"]) / "bin" / "python3", CONDA
    for name in names:
        for folder in folders:
            yield folder / name, PATH


def probe(command: Sequence[str], how: str, ask: Callable[[Sequence[str]], str]) -> Found:
    """What a candidate is. ``ask`` runs a command and gives its output.

    Raises:
        ValueError: it does not start, or cannot be used; the message says why, as part of a sentence.
    """
    name = " ".join(command)
    try:
        answer = json.loads(ask([*command, "-I", "-c", _QUESTION]).strip().splitlines()[-1])
        found = Found(str(answer["executable"]), str(answer["version"]), str(answer["tag"]), how)
        bits, has_venv = int(answer["bits"]), bool(answer["venv"])
    except (OSError, ValueError, IndexError, KeyError, TypeError):
        raise ValueError(f"{name} does not start") from None
    if found.release < OLDEST:
        raise ValueError(f"Python {found.version} at {name} is too old")
    if bits != 64:
        raise ValueError(f"Python {found.version} at {name} has {bits} bits instead of 64")
    if not has_venv:
        raise ValueError(f"Python {found.version} at {name} has no module venv")
    return found


def in_order(
    commands: Sequence[tuple[tuple[str, ...], str]], ask: Callable[[Sequence[str]], str], refused: list[str]
) -> Iterator[Found]:
    """The candidates that can be used, each asked only when it is its turn; those without all ready builds last.

    Args:
        refused: gets why others cannot be used.
    """
    later: dict[str, Found] = {}
    seen = set()
    for command, how in commands:
        try:
            found = probe(command, how, ask)
        except ValueError as error:
            refused.append(str(error))
            continue
        if found.executable in seen:
            continue
        seen.add(found.executable)
        if found.release in PREFERRED:
            yield found
        else:
            later.setdefault(found.executable, found)
    yield from later.values()


def none_found(refused: Sequence[str]) -> SetupError:
    """The error where no candidate is left."""
    said = "; ".join(dict.fromkeys(refused)) or "none was found"
    return SetupError(f"The engine needs Python 3.10 or newer with 64 bits ({said}); {REMEDY}.")
