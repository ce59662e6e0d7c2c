"""Where the set-up works: the user's data folder on each system, and the layout of what is in it."""

from __future__ import annotations

import os
import sys
from collections.abc import Mapping
from pathlib import Path, PurePath, PurePosixPath, PureWindowsPath

VARIABLE = "SLOPEWATCH_DATA"
STATE, LOCK, LOG, DOWNLOADS = "engine.json", "set-up.lock", "set-up.log", "downloads"
ENVIRONMENT, SCREENING = "environment-", "screening-"
"""How the names of the built folders begin; the rest is drawn for each build."""


def data_folder(setting: str = "", environ: Mapping[str, str] | None = None) -> Path:
    """This user's folder for the engine: the variable SLOPEWATCH_DATA, the setting, or the system's usual place."""
    variables = os.environ if environ is None else environ
    given = variables.get(VARIABLE, "") or setting
    return Path(given).expanduser() if given else Path(str(usual_data_folder(sys.platform, variables)))


def usual_data_folder(platform: str, environ: Mapping[str, str]) -> PurePath:
    """The usual place of a user's data on a system, by ``sys.platform`` and the environment; of no QGIS profile."""
    if platform == "win32":
        home = PureWindowsPath(environ.get("USERPROFILE", "C:\\"))
        local = environ.get("LOCALAPPDATA", "")
        return (PureWindowsPath(local) if local else home / "AppData" / "Local") / "SlopeWatch"
    home_folder = PurePosixPath(environ.get("HOME", "") or os.path.expanduser("~"))
    if platform == "darwin":
        return home_folder / "Library" / "Application Support" / "SlopeWatch"
    data = environ.get("XDG_DATA_HOME", "")
    return (PurePosixPath(data) if data.startswith("/") else home_folder / ".local" / "share") / "slopewatch"


def interpreter_in(environment: PurePath, platform: str) -> PurePath:
    """The interpreter of a virtual environment."""
    return environment / "Scripts" / "python.exe" if platform == "win32" else environment / "bin" / "python"


def packages_in(environment: PurePath, platform: str, version: str) -> PurePath:
    """The packages' folder of a virtual environment; ``version`` as "3.12.4"."""
    if platform == "win32":
        return environment / "Lib" / "site-packages"
    return environment / "lib" / ("python" + ".".join(version.split(".")[:2])) / "site-packages"
