"""Where a PDAL program may be on each system: with QGIS, on the search path, in conda. Nothing is started here."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from pathlib import PurePath, PurePosixPath, PureWindowsPath

QGIS_VARIABLE = "SLOPEWATCH_QGIS"
"""The folder that QGIS is installed in (its prefix path), which the plugin names."""
WITH_QGIS, ON_PATH, WITH_CONDA = "came with QGIS", "PATH", "conda"
_CONDA_ROOTS = ("miniforge3", "mambaforge", "miniconda3", "anaconda3", "miniforge", "miniconda", "anaconda")
_ENVIRONMENTS = ("slopewatch", "pdal")
"""Environments of conda that are looked into without being active."""
Places = Iterator[tuple[PurePath, str]]


def pdal_places(
    platform: str,
    environ: Mapping[str, str],
    is_file: Callable[[PurePath], bool],
    names_in: Callable[[PurePath], list[str]],
) -> list[tuple[PurePath, str]]:
    """The PDAL programs that exist, each with where it was found; in order, none twice.

    Args:
        platform: ``sys.platform``.
        names_in: names of what a folder holds, none where there is no such folder.
    """
    where = {"win32": _on_windows, "darwin": _on_macos}.get(platform, _on_linux)
    found: dict[PurePath, str] = {}
    for place, how in where(environ, names_in):
        if place not in found and is_file(place):
            found[place] = how
    return list(found.items())


def library_variables(
    platform: str, program: PurePath, environ: Mapping[str, str], is_file: Callable[[PurePath], bool]
) -> dict[str, str]:
    """Variables for a PDAL that came with QGIS or conda to find its data of reference systems.

    QGIS sets them for itself; they are taken from the engine's environment, whose libraries are others.
    """
    if platform not in ("win32", "darwin"):
        return {}
    root = program.parent.parent
    folders = {
        ("PROJ_DATA", "PROJ_LIB"): ("proj.db", ["share/proj", "../Resources/proj", "../Resources/qgis/proj"]),
        ("GDAL_DATA",): ("gdalvrt.xsd", ["share/gdal", "apps/gdal/share/gdal", "../Resources/gdal"]),
    }
    found: dict[str, str] = {}
    for variables, (file, places) in folders.items():
        for place in places:
            folder = root.parent / place[3:] if place.startswith("../") else root / place
            if is_file(folder / file) and not any(variable in environ for variable in variables):
                found |= dict.fromkeys(variables, str(folder))
                break
    return found


def _on_windows(environ: Mapping[str, str], names_in: Callable[[PurePath], list[str]]) -> Places:
    prefix = environ.get(QGIS_VARIABLE, "")
    if prefix:  # C:\OSGeo4W\apps\qgis, C:\Program Files\QGIS 3.40.1\apps\qgis-ltr; of conda: ...\Library
        for root in (PureWindowsPath(prefix), *list(PureWindowsPath(prefix).parents)[:2]):
            yield root / "bin" / "pdal.exe", WITH_QGIS
    for folder in environ.get("PATH", "").split(";"):
        if folder:
            yield PureWindowsPath(folder) / "pdal.exe", ON_PATH
    home = environ.get("USERPROFILE", "")
    roots = [environ.get("CONDA_PREFIX", "")]
    for base in (home, environ.get("LOCALAPPDATA", ""), environ.get("ProgramData", "")):
        roots += [str(PureWindowsPath(base) / name) for name in _CONDA_ROOTS] if base else []
    for one in filter(None, roots):
        for environment in _with_environments(PureWindowsPath(one)):
            yield environment / "Library" / "bin" / "pdal.exe", WITH_CONDA
    roots = [environ.get("OSGEO4W_ROOT", ""), "C:\\OSGeo4W", "C:\\OSGeo4W64"]
    programs = PureWindowsPath(environ.get("ProgramFiles", "C:\\Program Files"))
    roots += [str(programs / name) for name in sorted(names_in(programs), reverse=True) if name.startswith("QGIS")]
    for one in filter(None, roots):
        yield PureWindowsPath(one) / "bin" / "pdal.exe", WITH_QGIS


def _on_macos(environ: Mapping[str, str], names_in: Callable[[PurePath], list[str]]) -> Places:
    prefix = environ.get(QGIS_VARIABLE, "")
    bundles = [PurePosixPath(prefix)] if prefix else []  # /Applications/QGIS.app/Contents/MacOS
    applications = PurePosixPath("/Applications")
    for name in sorted(names_in(applications), reverse=True):
        if name.startswith("QGIS") and name.endswith(".app"):
            bundles.append(applications / name / "Contents" / "MacOS")
    for bundle in bundles:
        yield bundle / "bin" / "pdal", WITH_QGIS
        yield bundle / "pdal", WITH_QGIS
    yield from _on_path(environ)
    yield from _in_conda(environ)
    for folder in ("/opt/homebrew/bin", "/usr/local/bin", "/opt/local/bin"):  # not on the path of the Finder's programs
        yield PurePosixPath(folder) / "pdal", ON_PATH


def _on_linux(environ: Mapping[str, str], names_in: Callable[[PurePath], list[str]]) -> Places:
    prefix = environ.get(QGIS_VARIABLE, "")
    if prefix:
        yield PurePosixPath(prefix) / "bin" / "pdal", WITH_QGIS
    yield from _on_path(environ)
    yield from _in_conda(environ)


def _on_path(environ: Mapping[str, str]) -> Places:
    for folder in environ.get("PATH", "").split(":"):
        if folder:
            yield PurePosixPath(folder) / "pdal", ON_PATH


def _in_conda(environ: Mapping[str, str]) -> Places:
    home = environ.get("HOME", "")
    roots = [environ.get("CONDA_PREFIX", "")]
    for base in filter(None, (home, f"{home}/opt" if home else "", "/opt")):
        roots += [f"{base}/{name}" for name in _CONDA_ROOTS]
    for root in filter(None, roots):
        for environment in _with_environments(PurePosixPath(root)):
            yield environment / "bin" / "pdal", WITH_CONDA


def _with_environments(root: PurePath) -> list[PurePath]:
    return [*(root / "envs" / name for name in _ENVIRONMENTS), root]
