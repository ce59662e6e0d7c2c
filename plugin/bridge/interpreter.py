"""Where the engine's Python interpreter is, and the environment it runs in. Standard library only."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path

from .setup import shim, state

VARIABLE = "SLOPEWATCH_PYTHON"
PLUGIN_FOLDER = Path(__file__).resolve().parents[2]
SET_UP = "set it up with the algorithm Set up engine (Processing toolbox > SlopeWatch > Tools, slopewatch:setupengine)"

# Set by QGIS (or by what started it) for its own Python, GDAL, PROJ, PDAL and Qt; they break another interpreter's.
_FOREIGN = frozenset(
    [
        "PYTHONHOME",
        "PYTHONPATH",
        "PYTHONEXECUTABLE",
        "PYTHONSTARTUP",
        "PYTHONUSERBASE",
        "PYTHONINSPECT",
        "__PYVENV_LAUNCHER__",
        "VIRTUAL_ENV",
        "GDAL_DATA",
        "GDAL_DRIVER_PATH",
        "GEOTIFF_CSV",
        "PROJ_LIB",
        "PROJ_DATA",
        "PDAL_DRIVER_PATH",
        "LD_LIBRARY_PATH",
        "LD_PRELOAD",
        "QT_PLUGIN_PATH",
        "QT_QPA_PLATFORM",
    ]
)


class InterpreterNotFoundError(Exception):
    """No interpreter for the engine; the message says where it was looked for and the remedy."""


def find_interpreter(
    setting: str = "",
    folder: Path = PLUGIN_FOLDER,
    environ: Mapping[str, str] | None = None,
    data: Path | None = None,
) -> tuple[Path, str]:
    """The engine's interpreter and how it was found.

    In this order: the environment variable SLOPEWATCH_PYTHON, the plugin's setting, the ``.venv`` in the plugin's
    folder (its symbolic link resolved), what the set-up built in the folder ``data``. One that is named but missing is
    an error, never a reason to take another.

    Raises:
        InterpreterNotFoundError: none is there.
    """
    variables = os.environ if environ is None else environ
    for how, value in ((f"environment variable {VARIABLE}", variables.get(VARIABLE, "")), ("setting", setting)):
        if value:
            path = Path(value).expanduser()
            if not path.is_file():
                raise InterpreterNotFoundError(
                    f"The engine's Python interpreter {path} ({how}) does not exist; correct the {how} or clear it."
                )
            return path, how
    for path in own_environments(folder):
        if path.is_file():
            return path, "the plugin's own environment"
    built = None if data is None else state.read(data)
    if data is not None and built is not None:
        path = state.interpreter(data, built)
        if path.is_file():
            return path, "the set-up"
        raise InterpreterNotFoundError(
            f"The SlopeWatch engine in {data} is not whole any more (its Python was moved or removed); {SET_UP}."
        )
    raise InterpreterNotFoundError(
        f"The SlopeWatch engine is missing; {SET_UP}, or give the interpreter of an environment of your own under "
        f"Settings > Options > SlopeWatch or in {VARIABLE}."
    )


def own_environments(folder: Path) -> list[Path]:
    """Where the interpreter of the plugin folder's own ``.venv`` may be, on any system."""
    base = Path(folder).resolve() / ".venv"
    posix, windows = base / "bin" / "python", base / "Scripts" / "python.exe"
    return [windows, posix] if os.name == "nt" else [posix, windows]


def child_environment(environ: Mapping[str, str] | None = None) -> dict[str, str]:
    """The environment for the engine: without what QGIS set for itself, with UTF-8 and unbuffered output."""
    variables = os.environ if environ is None else environ
    kept = {k: v for k, v in variables.items() if k.upper() not in _FOREIGN and not k.startswith("DYLD_")}
    # PYTHONSAFEPATH: a numpy.py in the user's current folder must not shadow the engine's (Python 3.11 and later).
    kept.update(PYTHONUTF8="1", PYTHONUNBUFFERED="1", PYTHONSAFEPATH="1")
    # the environment of the set-up takes the engine's code from here
    kept[shim.VARIABLE] = str(PLUGIN_FOLDER)
    return kept
