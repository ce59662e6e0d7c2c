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
    return "build_private_pdal() { echo would fetch one; return 1; }\napt_candidate() { :; }\n"


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


def test_without_any_a_private_one_is_fetched_and_without_that_the_set_up_goes_on(shell, no_private_copy):
    result = shell(no_private_copy + "setup_pdal")
    assert result.returncode == 0, result.stderr
    assert "would fetch one" in result.stdout
    assert "no PDAL could be had; laspy and shapely read and clip clouds instead" in result.stdout
    again = shell(no_private_copy + "setup_pdal")
    assert (again.returncode, "would fetch one" in again.stdout) == (0, False), "the network is not asked again"
    assert "scripts/setup.sh pdal" in again.stdout
    assert "would fetch one" in shell(no_private_copy + "setup_pdal again").stdout


def test_a_pdal_that_was_installed_later_is_used(shell, tmp_path, no_private_copy):
    assert shell(no_private_copy + "setup_pdal").returncode == 0
    on_path = working(tmp_path / "bin" / "pdal", "2.8.1")
    found = shell(no_private_copy + "setup_pdal", path=str(on_path.parent))
    assert f"{on_path} works (version 2.8.1)" in found.stdout


def test_none_asks_for_no_pdal(shell, tmp_path, no_private_copy):
    done = shell(no_private_copy + "setup_pdal", SLOPEWATCH_PDAL="none")
    assert done.returncode == 0, done.stderr
    assert "PDAL: none" in done.stdout
    assert "would fetch one" not in done.stdout


@pytest.mark.skipif(shutil.which("apt-get") is None, reason="there is no apt-get")
def test_blocked_mirrors_do_not_stop_the_set_up(shell, checkout):
    done = shell("apt_candidate() { :; }\nsetup_pdal", SLOPEWATCH_DEBIAN_MIRROR="http://127.0.0.1:9/")
    assert done.returncode == 0, done.stderr
    assert "http://127.0.0.1:9 did not give it" in done.stdout
    assert "archive.debian.org" not in done.stdout + done.stderr, "the mirror that is given replaces all places"
    assert "no PDAL could be had" in done.stdout
    assert not (checkout / ".pdal").exists()


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


def test_mirrors_are_the_one_given_or_the_machines_own_and_the_archive(shell):
    own = "apt_mirror() { echo http://mirror.example/debian/; }\n"
    mirrors = shell(own + "pdal_mirrors").stdout.split()
    assert mirrors == ["http://mirror.example/debian", "http://archive.debian.org/debian"]
    given = "SLOPEWATCH_DEBIAN_MIRROR=http://other.example/debian/\n"
    assert shell(own + given + "pdal_mirrors").stdout.split() == ["http://other.example/debian"]
    none = "apt_mirror() { :; }\n"
    assert shell(none + "pdal_mirrors").stdout.split() == ["http://archive.debian.org/debian"]


@pytest.mark.parametrize("secure", [True, False])
def test_security_updates_are_asked_for_and_not_required(shell, tmp_path, secure):
    """apt is played: PDAL is downloaded whether the security suite answers or not."""
    script = f"""apt-get() {{
    [[ $* != *install* ]] || {{ echo downloaded; return; }}
    grep -q debian-security "{tmp_path}/work/etc/sources.list" || return 0
    return {0 if secure else 1}
}}
pdal_download http://mirror.example/debian "{tmp_path}/work"
"""
    done = shell(script)
    assert done.returncode == 0, done.stderr
    sources = (tmp_path / "work" / "etc" / "sources.list").read_text(encoding="utf-8")
    assert "http://mirror.example/debian bullseye main" in sources
    assert "http://mirror.example/debian-security bullseye-security main" in sources
    assert "downloaded" in done.stdout
    assert ("without Debian 11's security updates" in done.stdout) is not secure


def test_an_unreachable_mirror_is_followed_by_the_next(shell, tmp_path):
    script = (
        "pdal_mirrors() { printf '%s\\n' http://first http://second; }\n"
        f'pdal_download() {{ echo "$1" >>"{tmp_path}/asked"; return 1; }}\n'
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
