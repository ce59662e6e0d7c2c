"""Which PDAL the set-up takes, and the wrapper that starts the private one."""

from __future__ import annotations

import json
import shutil
import subprocess
from pathlib import Path

import pytest

# What the set-up's trial asks of a PDAL: a version, a pipeline from standard input, a count of points.
WORKING = """echo "$1" >>"$0.calls"
case $1 in
--version) echo "pdal {version} (git-version: Release)" ;;
pipeline) cat >/dev/null ;;
info) echo '"num_points": 10'; sleep 0.1; seq 20000 ;;
esac"""


def write_program(path: Path, text: str) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(f"#!/bin/sh\n{text}\n", encoding="utf-8")
    path.chmod(0o755)
    return path


def working(path: Path, version: str) -> Path:
    return write_program(path, WORKING.format(version=version))


def calls(program: Path) -> list[str]:
    log = Path(f"{program}.calls")
    return log.read_text(encoding="utf-8").split() if log.exists() else []


@pytest.fixture
def no_private_copy() -> str:
    """Bash that says so instead of fetching PDAL from the network."""
    return "build_private_pdal() { die 'would fetch one'; }\napt_candidate() { :; }\n"


def test_a_pdal_on_path_is_used_not_replaced(shell, checkout, tmp_path, no_private_copy):
    on_path = working(tmp_path / "bin" / "pdal", "2.8.1")
    working(checkout / ".pdal" / "bin" / "pdal", "2.2.0")
    result = shell(no_private_copy + "find_usable_pdal", path=str(on_path.parent))
    assert result.stdout.strip() == str(on_path)


@pytest.mark.parametrize("broken", ["exit 127", "echo pdal 2.1.0", "[ $1 = --version ] && echo pdal 2.8.1"])
def test_a_pdal_that_does_not_work_is_passed_over(shell, checkout, tmp_path, no_private_copy, broken):
    on_path = write_program(tmp_path / "bin" / "pdal", broken)
    private = working(checkout / ".pdal" / "bin" / "pdal", "2.2.0")
    result = shell(no_private_copy + "find_usable_pdal", path=str(on_path.parent))
    assert result.stdout.strip() == str(private)


def test_the_environment_variable_comes_first(shell, tmp_path, no_private_copy):
    on_path = working(tmp_path / "bin" / "pdal", "2.8.1")
    named = working(tmp_path / "named" / "pdal", "2.5.0")
    result = shell(no_private_copy + "find_usable_pdal", path=str(on_path.parent), SLOPEWATCH_PDAL=str(named))
    assert result.stdout.strip() == str(named)


def test_a_named_pdal_that_does_not_work_stops_the_set_up(shell, tmp_path, no_private_copy):
    named = write_program(tmp_path / "named" / "pdal", "exit 1")
    result = shell(no_private_copy + "setup_pdal", SLOPEWATCH_PDAL=str(named))
    assert result.returncode == 1
    assert "SLOPEWATCH_PDAL" in result.stderr
    assert str(named) in result.stderr


def test_without_any_a_private_one_is_fetched(shell, no_private_copy):
    result = shell(no_private_copy + "setup_pdal")
    assert result.returncode == 1
    assert "would fetch one" in result.stderr


def test_the_second_run_does_not_try_it_again_until_it_changes(shell, tmp_path, no_private_copy):
    on_path = working(tmp_path / "bin" / "pdal", "2.8.1")
    assert shell(no_private_copy + "setup_pdal", path=str(on_path.parent)).returncode == 0
    tried = len(calls(on_path))
    assert tried > 0
    again = shell(no_private_copy + "setup_pdal", path=str(on_path.parent))
    assert "as before" in again.stdout
    assert len(calls(on_path)) == tried
    working(on_path, "2.9.10")
    shell(no_private_copy + "setup_pdal", path=str(on_path.parent))
    assert len(calls(on_path)) > tried


def test_mirrors_are_the_one_given_and_the_machines_own(shell):
    own = "apt_mirror() { echo http://mirror.example/debian/; }\n"
    assert shell(own + "pdal_mirrors").stdout.split() == ["http://mirror.example/debian"]
    given = "SLOPEWATCH_DEBIAN_MIRROR=http://archive.example/debian\n"
    mirrors = shell(own + given + "pdal_mirrors").stdout.split()
    assert mirrors == ["http://archive.example/debian", "http://mirror.example/debian"]
    same = "SLOPEWATCH_DEBIAN_MIRROR=http://mirror.example/debian\n"
    assert len(shell(own + same + "pdal_mirrors").stdout.split()) == 1, "one mirror is not asked twice"


def test_an_unreachable_mirror_is_followed_by_the_next(shell, tmp_path):
    script = (
        "pdal_mirrors() { printf '%s\\n' http://first http://second; }\n"
        f'pdal_download() {{ echo "$1" >>"{tmp_path}/asked"; [[ $1 == http://second ]] || return 1; die enough; }}\n'
        "build_private_pdal"
    )
    result = shell(script)
    assert (tmp_path / "asked").read_text(encoding="utf-8").split() == ["http://first", "http://second"]
    assert "http://first did not give it" in result.stdout


@pytest.fixture
def private_prefix(shell, checkout: Path) -> Path:
    """A private prefix whose loader reports how it was started."""
    report = "import json, os, sys; print(json.dumps([os.getpid(), sys.argv[1:], dict(os.environ)]))"
    loader = checkout / ".pdal" / "lib" / "x86_64-linux-gnu" / "ld-2.31.so"
    write_program(loader, f"exec python3 -c '{report}' \"$@\"")
    assert shell('pdal_write_wrapper "$PDAL_PREFIX"').returncode == 0
    return checkout / ".pdal"


def start(program: Path, *arguments: str, **variables: str) -> tuple[int, list[str], dict[str, str], int]:
    environment = {"PATH": "/usr/bin:/bin", **variables}
    process = subprocess.Popen([program, *arguments], env=environment, stdout=subprocess.PIPE, text=True)
    text, _ = process.communicate(timeout=600)
    pid, seen, inherited = json.loads(text)
    return pid, seen, inherited, process.pid


def test_wrapper_starts_the_private_program_with_its_own_libraries(private_prefix):
    pid, arguments, environment, started = start(
        private_prefix / "bin" / "pdal", "info", "a b.laz", LD_LIBRARY_PATH="/elsewhere", PROJ_DATA="/newer/proj"
    )
    assert pid == started, "the wrapper must become the program, else signals do not reach it"
    assert arguments[0] == "--library-path"
    folders = arguments[1].split(":")
    assert folders[0] == f"{private_prefix}/usr/lib/x86_64-linux-gnu"
    assert all(folder.startswith(str(private_prefix)) for folder in folders)
    assert arguments[2:] == [f"{private_prefix}/usr/bin/pdal", "info", "a b.laz"]
    assert environment["PROJ_LIB"] == f"{private_prefix}/usr/share/proj"
    assert environment["GDAL_DATA"] == f"{private_prefix}/usr/share/gdal"
    assert not {"LD_LIBRARY_PATH", "PROJ_DATA"} & set(environment)


def test_wrapper_works_through_a_link_and_after_a_move(private_prefix, tmp_path):
    moved = tmp_path / "moved here"
    shutil.move(private_prefix, moved)
    link = tmp_path / "pdal-link"
    link.symlink_to(moved / "bin" / "pdal")
    _, arguments, _, _ = start(link, "--version")
    assert arguments[2] == f"{moved}/usr/bin/pdal"


def test_the_private_pdal_of_this_checkout_runs(root):
    program = root / ".pdal" / "bin" / "pdal"
    if not program.exists():
        pytest.skip("another PDAL is used on this machine, so there is no private one")
    result = subprocess.run(
        [program, "--drivers"],
        env={"PATH": "/usr/bin:/bin", "LD_LIBRARY_PATH": "/nonexistent"},
        text=True,
        capture_output=True,
        check=True,
        timeout=600,
    )
    for stage in ("filters.crop", "filters.outlier", "readers.las", "writers.las", "filters.transformation"):
        assert stage in result.stdout
