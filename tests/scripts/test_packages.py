"""What is shipped: the plugin's zip as QGIS's plugin repository takes it, and the wheel with its packages and data."""

from __future__ import annotations

import ast
import configparser
import posixpath
import re
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path, PurePosixPath

import pytest

PACKAGES = ("cli", "engine", "interface", "models", "plugin", "processing_algorithms", "simulation", "workflows")


def tracked(root: Path, *more: str) -> list[str]:
    if shutil.which("git") is None or not (root / ".git").exists():
        pytest.skip("this is no git checkout, so what is tracked is not known")
    command = ["git", "-c", "safe.directory=*", "ls-files", "-z", *more]
    text = subprocess.run(command, cwd=root, check=True, text=True, stdout=subprocess.PIPE).stdout
    return [name for name in text.split("\0") if name and (root / name).is_file()]


@pytest.fixture(scope="module")
def plugin_zip(root, tmp_path_factory) -> zipfile.ZipFile:
    tracked(root)
    archive = tmp_path_factory.mktemp("zip") / "plugin.zip"
    subprocess.run(["bash", root / "scripts" / "package.sh", archive], cwd=root, check=True, stdout=subprocess.PIPE)
    return zipfile.ZipFile(archive)


def test_zip_has_one_top_folder_with_what_qgis_asks_for(plugin_zip):
    names = plugin_zip.namelist()
    assert {name.split("/")[0] for name in names} == {"slopewatch"}
    for needed in ("__init__.py", "metadata.txt", "LICENSE", "README.md", "interface/dates.py", "plugin/provider.py"):
        assert f"slopewatch/{needed}" in names


def test_zip_leaves_out_what_qgis_refuses_and_users_do_not_need(plugin_zip):
    for name in plugin_zip.namelist():
        path = PurePosixPath(name)
        assert path.suffix not in {".sh", ".so", ".pyc", ".dll", ".exe", ".dylib", ".pyd", ".whl", ".zip", ".bat"}, name
        assert not {"tests", "__pycache__", ".ci", "scripts", "lab", "docs"} & set(path.parts), name
        assert not any(part.startswith(".") for part in path.parts), name
    assert sum(entry.compress_size for entry in plugin_zip.infolist()) <= 4500 * 1024


EXECUTABLE = (b"\x7fELF", b"MZ", b"\xcf\xfa\xed\xfe", b"\xca\xfe\xba\xbe", b"#!/bin/")


def test_zip_holds_no_program_under_any_name(plugin_zip):
    for entry in plugin_zip.infolist():
        assert not plugin_zip.read(entry).startswith(EXECUTABLE), entry.filename
        assert not entry.filename.startswith("/")
        assert ".." not in PurePosixPath(entry.filename).parts


def test_zip_holds_what_its_own_help_names(plugin_zip):
    """Relative links and pictures; the readme and the changelog may also name documents of the repository."""
    names = set(plugin_zip.namelist())
    of_repository = tuple(f"slopewatch/{name}" for name in ("docs/", "CONTRIBUTING.md", "SECURITY.md", "lab/"))
    checked = 0
    for name in sorted(names):
        if not name.endswith((".md", ".html")) or "/templates/" in name:
            continue
        text = plugin_zip.read(name).decode("utf-8")
        text = re.sub(r"^```.*?^```|`[^`\n]*`", "", text, flags=re.S | re.M)
        found = re.findall(r"\]\(\s*([^)\s]+)\s*\)", text) + re.findall(r'\b(?:src|href)="([^"]+)"', text)
        for target in (one.partition("#")[0] for one in found):
            if target and not re.match(r"[a-z]+:", target):
                place = posixpath.normpath(posixpath.join(posixpath.dirname(name), target))
                there = place in names or any(other.startswith(f"{place}/") for other in names)
                assert there or (name.endswith(".md") and place.startswith(of_repository)), f"{name}: {target}"
                checked += 1
    assert checked > 20


def test_zip_holds_the_locks_and_no_tests_of_them(plugin_zip):
    for lock in ("engine.lock", "screening.lock"):
        assert b"--hash=sha256:" in plugin_zip.read(f"slopewatch/plugin/bridge/setup/{lock}")


def test_the_licence_goes_with_qgis_and_is_in_the_zip(root, plugin_zip):
    text = plugin_zip.read("slopewatch/LICENSE").decode("utf-8")
    assert "GNU GENERAL PUBLIC LICENSE" in text[:200]
    assert "Version 3, 29 June 2007" in text[:200]
    assert 'license = "GPL-3.0-or-later"' in (root / "pyproject.toml").read_text(encoding="utf-8")


def test_icon_named_in_the_metadata_is_in_the_zip(plugin_zip):
    parser = configparser.ConfigParser(interpolation=None)
    parser.read_string(plugin_zip.read("slopewatch/metadata.txt").decode("utf-8"))
    assert f"slopewatch/{parser['general']['icon']}" in plugin_zip.namelist()


def metadata(root: Path) -> configparser.SectionProxy:
    parser = configparser.ConfigParser(interpolation=None)
    parser.optionxform = str  # type: ignore[assignment,method-assign]
    parser.read(root / "metadata.txt", encoding="utf-8")
    return parser["general"]


def test_metadata_names_everything_the_plugin_repository_asks_for(root):
    general = metadata(root)
    needed = (
        "name description version qgisMinimumVersion author email about tracker repository homepage tags icon changelog"
    )
    assert [key for key in needed.split() if not general.get(key)] == []
    assert general["qgisMinimumVersion"] == "3.34"
    assert general["qgisMaximumVersion"] == "4.99"
    assert general["hasProcessingProvider"] == "yes"
    for key in ("homepage", "repository", "tracker"):
        assert re.fullmatch(r"https://[\w.-]+/[\w./-]+", general[key]), key
    assert re.fullmatch(r"[^@\s]+@[\w-]+(\.[\w-]+)+", general["email"])
    assert re.fullmatch(r"\d+\.\d+\.\d+", general["version"])
    assert "plugin" not in general["name"].lower()
    assert re.fullmatch(r"[A-Za-z][A-Za-z0-9_-]*", "slopewatch"), "the folder's name"
    assert len(general["description"]) < 120
    assert "External dependency" in general["about"], "what is downloaded must be stated there"
    tags = general["tags"].split(",")
    assert len(tags) == len({tag.strip().lower() for tag in tags})
    assert general["category"] in ("Raster", "Vector", "Database", "Mesh", "Web", "Analysis")
    assert (root / general["icon"]).is_file()


def test_one_version_everywhere(root):
    from slopewatch.engine.core.version import VERSION

    assert metadata(root)["version"] == VERSION
    assert VERSION in metadata(root)["changelog"]
    assert f"\nversion: {VERSION}\n" in (root / "CITATION.cff").read_text(encoding="utf-8")
    assert re.search(
        rf"^## \[{VERSION}\] - \d{{4}}-\d\d-\d\d$", (root / "CHANGELOG.md").read_text(encoding="utf-8"), re.M
    )


REFUSED_CALLS = {"eval", "exec", "pickle.load", "pickle.loads", "yaml.load", "os.system"}


def test_no_call_that_the_plugin_repository_refuses(root):
    found = []
    for name in tracked(root):
        if not name.endswith(".py") or name.split("/")[0] not in (*PACKAGES, "__init__.py"):
            continue
        for node in ast.walk(ast.parse((root / name).read_text(encoding="utf-8"))):
            if not isinstance(node, ast.Call):
                continue
            called = ast.unparse(node.func)
            shell = any(word.arg == "shell" and ast.unparse(word.value) != "False" for word in node.keywords)
            if called in REFUSED_CALLS or called.endswith(".extractall") or shell:
                found.append(f"{name}:{node.lineno} {called}")
    assert found == []


@pytest.fixture(scope="module")
def wheel(root, tmp_path_factory) -> zipfile.ZipFile:
    """The wheel, built from a copy of what the working tree holds."""
    pytest.importorskip("setuptools")
    folder = tmp_path_factory.mktemp("wheel")
    for name in tracked(root, "--cached", "--others", "--exclude-standard"):
        if name.split("/")[0] in (*PACKAGES, "lab") or "/" not in name:
            target = folder / "source" / name
            target.parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(root / name, target)
    command = [sys.executable, "-m", "pip", "-qq", "wheel", "--no-deps", "--no-build-isolation", "--no-index"]
    subprocess.run([*command, "-w", folder, folder / "source"], check=True, timeout=600)
    return zipfile.ZipFile(next(folder.glob("slopewatch-*.whl")))


def test_wheel_holds_every_module_and_data_file_of_the_packages(root, wheel):
    there = set(wheel.namelist())
    every = tracked(root, "--cached", "--others", "--exclude-standard")
    names = [name for name in every if name.split("/")[0] in PACKAGES]
    assert len(names) > 300
    for name in names:
        assert f"slopewatch/{name}" in there, "see package-data in pyproject.toml and the parts in setup.py"


def test_wheel_holds_nothing_else(wheel):
    top = {name.split("/")[0] for name in wheel.namelist()}
    assert {name for name in top if not name.endswith(".dist-info")} == {"slopewatch"}
    assert not [name for name in wheel.namelist() if name.startswith(("slopewatch/tests", "slopewatch/scripts"))]
    entry_points = next(name for name in wheel.namelist() if name.endswith("entry_points.txt"))
    assert "slopewatch = slopewatch.cli:main" in wheel.read(entry_points).decode("utf-8")
