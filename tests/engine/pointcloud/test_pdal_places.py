"""Where PDAL is looked for on Windows and macOS, in the layouts that their installers make; on any system."""

from __future__ import annotations

from pathlib import PurePath, PurePosixPath, PureWindowsPath

import pytest
from slopewatch.engine.pointcloud.pdal_places import library_variables, pdal_places


def found(platform: str, files: list[str], environ: dict[str, str]) -> list[tuple[str, str]]:
    """What is found where only these files exist, as (path, how)."""
    kind = PureWindowsPath if platform == "win32" else PurePosixPath
    there = {kind(file) for file in files}
    parents = {(parent, child.name) for file in there for child in (file, *file.parents) for parent in [child.parent]}

    def names_in(folder: PurePath) -> list[str]:
        return [name for parent, name in parents if parent == folder and name]

    return [(str(path), how) for path, how in pdal_places(platform, environ, there.__contains__, names_in)]


OSGEO4W = r"C:\OSGeo4W\bin\pdal.exe"
INSTALLER = r"C:\Program Files\QGIS 3.40.6\bin\pdal.exe"
OLDER = r"C:\Program Files\QGIS 3.34.1\bin\pdal.exe"
CONDA = r"C:\Users\Ana\miniforge3\envs\slopewatch\Library\bin\pdal.exe"


@pytest.mark.parametrize(
    ("prefix", "program"),
    [
        (r"C:\OSGeo4W\apps\qgis-ltr", OSGEO4W),
        ("C:/Program Files/QGIS 3.40.6/apps/qgis", INSTALLER),  # as QGIS writes it
        (r"C:\conda\Library", r"C:\conda\Library\bin\pdal.exe"),
    ],
)
def test_on_windows_it_comes_with_qgis(prefix: str, program: str) -> None:
    assert found("win32", [program], {"SLOPEWATCH_QGIS": prefix})[0] == (program, "came with QGIS")


def test_on_windows_the_qgis_in_use_comes_first_then_the_path_conda_and_other_qgis() -> None:
    environ = {
        "SLOPEWATCH_QGIS": r"C:\OSGeo4W\apps\qgis",
        "PATH": r"C:\Windows;;D:\tools",
        "USERPROFILE": r"C:\Users\Ana",
        "ProgramFiles": r"C:\Program Files",
    }
    files = [OLDER, INSTALLER, CONDA, r"D:\tools\pdal.exe", OSGEO4W]
    assert found("win32", files, environ) == [
        (OSGEO4W, "came with QGIS"),
        (r"D:\tools\pdal.exe", "PATH"),
        (CONDA, "conda"),
        (INSTALLER, "came with QGIS"),
        (OLDER, "came with QGIS"),
    ]


def test_on_windows_without_qgis_or_a_path_the_usual_folders_are_looked_into() -> None:
    assert found("win32", [INSTALLER], {}) == [(INSTALLER, "came with QGIS")]
    assert found("win32", [], {}) == []


def test_on_macos_the_bundle_comes_first() -> None:
    own = "/Applications/QGIS-LTR.app/Contents/MacOS/bin/pdal"
    other = "/Applications/QGIS.app/Contents/MacOS/bin/pdal"
    files = ["/opt/homebrew/bin/pdal", other, own, "/Users/ana/miniconda3/envs/pdal/bin/pdal"]
    environ = {"SLOPEWATCH_QGIS": "/Applications/QGIS-LTR.app/Contents/MacOS", "HOME": "/Users/ana", "PATH": "/usr/bin"}
    assert [path for path, _ in found("darwin", files, environ)] == [own, other, files[3], files[0]]


def test_on_linux_one_program_by_two_ways_is_named_once() -> None:
    environ = {"SLOPEWATCH_QGIS": "/usr", "PATH": "/usr/bin:/bin", "CONDA_PREFIX": "/opt/c"}
    files = ["/usr/bin/pdal", "/opt/c/bin/pdal"]
    assert found("linux", files, environ) == [("/usr/bin/pdal", "came with QGIS"), ("/opt/c/bin/pdal", "conda")]


@pytest.mark.parametrize(
    ("platform", "program", "proj"),
    [
        ("win32", PureWindowsPath(OSGEO4W), PureWindowsPath(r"C:\OSGeo4W\share\proj")),
        (
            "darwin",
            PurePosixPath("/Applications/QGIS.app/Contents/MacOS/bin/pdal"),
            PurePosixPath("/Applications/QGIS.app/Contents/Resources/proj"),
        ),
    ],
)
def test_its_reference_systems_are_found(platform: str, program: PurePath, proj: PurePath) -> None:
    def is_file(path: PurePath) -> bool:
        return path == proj / "proj.db"

    assert library_variables(platform, program, {}, is_file) == {"PROJ_DATA": str(proj), "PROJ_LIB": str(proj)}
    assert library_variables(platform, program, {"PROJ_DATA": "elsewhere"}, is_file) == {}
    assert library_variables("linux", program, {}, is_file) == {}
