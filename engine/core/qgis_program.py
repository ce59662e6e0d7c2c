"""The program ``qgis_process`` of a QGIS, and one run of an algorithm of the plugin in it, in a profile of its own."""

from __future__ import annotations

import json
import os
import re
import shutil
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from . import child_process
from .errors import EngineError, InputError
from .messages import one_line
from .temporary_folders import temporary_folder

VARIABLE = "SLOPEWATCH_QGIS"
"""The folder that QGIS is installed in, or its qgis_process."""
_NAMES = ("qgis_process", "qgis_process.bat", "qgis_process-qgis.bat", "qgis_process-qgis-ltr.bat", "qgis_process.exe")
_FOLDERS = ("", "bin", "MacOS/bin", "Contents/MacOS/bin")
_MAC = ("/Applications", "QGIS*.app/Contents/MacOS/bin/qgis_process")
_PACKAGE_NAME = "slopewatch"
_PACKAGE = Path(__file__).resolve().parents[2]
_FROM_QGIS = ("PYTHONHOME", "PYTHONPATH", "PYTHONEXECUTABLE", "VIRTUAL_ENV", "GDAL_DATA", "PROJ_LIB", "PROJ_DATA")
"""Of the engine's environment, whose libraries are others."""
_PROFILE_BYTES = 5_000_000
_TEMPORARY = ("TMPDIR", "TEMP", "TMP")


def find_qgis_process(environ: Mapping[str, str] = os.environ) -> Path:
    """The program: where the variable says, else on PATH, else among the applications of macOS.

    Raises:
        InputError: there is none.
    """
    named = environ.get(VARIABLE, "")
    if named:
        place = Path(named)
        candidates = [place, *(place / folder / name for folder in _FOLDERS for name in _NAMES)]
        found = next((path for path in candidates if path.is_file()), None)
        if found is None:
            raise InputError(f"{VARIABLE} names {named}, where no qgis_process is; name the folder that QGIS is in.")
        return found
    on_path = next((path for name in _NAMES if (path := shutil.which(name, path=environ.get("PATH")))), None)
    if on_path:
        return Path(on_path)
    if sys.platform == "darwin":
        root, pattern = _MAC
        for application in sorted(Path(root).glob(pattern)):
            return application
    raise InputError(
        f"A project is made by QGIS, and no qgis_process was found; install QGIS 3.34 or later, or name its folder in "
        f"{VARIABLE}."
    )


def run_algorithm(
    program: Path, algorithm: str, parameters: Mapping[str, str], environ: Mapping[str, str]
) -> dict[str, Any]:
    """Run an algorithm of the plugin; its results.

    The plugin is this package, switched on in an empty profile: the user's own is neither read nor changed.

    Raises:
        InputError: the algorithm refuses what was given, with its own sentence.
        EngineError: QGIS does not start, or fails otherwise.
    """
    with temporary_folder("qgis", needed_bytes=_PROFILE_BYTES) as folder:
        variables = _environment(folder, program, environ)
        given = [f"--{name}={value}" for name, value in parameters.items()]
        enabled = child_process.run_child([program, "plugins", "enable", _PACKAGE_NAME], environment=variables)
        if enabled.returncode:
            raise EngineError(f"QGIS does not take the plugin: {_last_line(enabled.stderr)}")
        command: list[str | os.PathLike[str]] = [program, "--json", "run", f"{_PACKAGE_NAME}:{algorithm}", *given]
        done = child_process.run_child(command, environment=variables)
    if done.returncode == 1:  # what an algorithm refuses
        raise InputError(_last_line(done.stderr))
    if done.returncode:
        raise EngineError(f"QGIS ended with code {done.returncode}: {_last_line(done.stderr)}")
    try:
        results = json.loads(done.stdout)["results"]
    except (ValueError, KeyError, TypeError) as error:
        raise EngineError(f"QGIS said nothing that can be read: {_last_line(done.stdout)}") from error
    return dict(results)


def _environment(folder: Path, program: Path, environ: Mapping[str, str]) -> dict[str, str]:
    plugins = _PACKAGE.parent
    if _PACKAGE.name != _PACKAGE_NAME or os.name == "posix":
        # a checkout may have another name than the plugin, and next to it may be others
        plugins = folder / "plugins"
        plugins.mkdir()
        (plugins / _PACKAGE_NAME).symlink_to(_PACKAGE, target_is_directory=True)
    kept = {name: value for name, value in environ.items() if name not in _FROM_QGIS}
    if sys.platform.startswith("linux"):
        # QGIS finds its Python's libraries by the first python3 on the path, which must be the system's
        kept["PATH"] = os.pathsep.join([str(program.parent), "/usr/bin", "/bin", kept.get("PATH", "")])
        kept.setdefault("QT_QPA_PLATFORM", "offscreen")
        kept.setdefault("XDG_RUNTIME_DIR", str(folder))
    kept |= dict.fromkeys(_TEMPORARY, str(folder))
    return kept | {"QGIS_PLUGINPATH": str(plugins), "QGIS_CUSTOM_CONFIG_PATH": str(folder / "profile")}


def _last_line(output: bytes | str) -> str:
    """The last sentence of what a program said."""
    text = output.decode(errors="replace") if isinstance(output, bytes) else output
    lines = [line.strip() for line in text.splitlines() if line.strip() and not re.match(r"[-=]+$", line.strip())]
    return one_line(lines[-1]) if lines else "no reason was given."
