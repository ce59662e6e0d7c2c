"""Places on each system, the state's file, the locks of the zip, proxies, children."""

from __future__ import annotations

import json
import os
import sys
import time
from pathlib import Path, PurePosixPath, PureWindowsPath

import pytest
from slopewatch.plugin.bridge.setup import places, state
from slopewatch.plugin.bridge.setup.children import run_child
from slopewatch.plugin.bridge.setup.network import pip_environment, proxy_variables, without_passwords
from slopewatch.plugin.bridge.setup.problems import SetupCancelledError
from slopewatch.plugin.bridge.setup.requirements import ENGINE_LOCK, SCREENING_LOCK, read_lock


@pytest.mark.parametrize(
    ("platform", "environ", "expected"),
    [
        ("win32", {"LOCALAPPDATA": r"C:\Users\Ana\AppData\Local"}, r"C:\Users\Ana\AppData\Local\SlopeWatch"),
        ("win32", {"USERPROFILE": r"C:\Users\Ana"}, r"C:\Users\Ana\AppData\Local\SlopeWatch"),
        ("darwin", {"HOME": "/Users/ana"}, "/Users/ana/Library/Application Support/SlopeWatch"),
        ("linux", {"HOME": "/home/ana"}, "/home/ana/.local/share/slopewatch"),
        ("linux", {"HOME": "/home/ana", "XDG_DATA_HOME": "/big"}, "/big/slopewatch"),
        ("linux", {"HOME": "/home/ana", "XDG_DATA_HOME": "relative"}, "/home/ana/.local/share/slopewatch"),
    ],
)
def test_the_data_folder_of_each_system(platform: str, environ: dict[str, str], expected: str) -> None:
    assert str(places.usual_data_folder(platform, environ)) == expected


def test_the_variable_and_then_the_setting_move_it(tmp_path: Path) -> None:
    assert places.data_folder("~/x", {"SLOPEWATCH_DATA": str(tmp_path)}) == tmp_path
    assert places.data_folder(str(tmp_path), {}) == tmp_path


def test_an_environments_layout() -> None:
    windows, posix = PureWindowsPath(r"C:\d\environment-1"), PurePosixPath("/d/environment-1")
    assert str(places.interpreter_in(windows, "win32")) == r"C:\d\environment-1\Scripts\python.exe"
    assert str(places.packages_in(windows, "win32", "3.12.4")) == r"C:\d\environment-1\Lib\site-packages"
    assert str(places.interpreter_in(posix, "darwin")) == "/d/environment-1/bin/python"
    assert str(places.packages_in(posix, "linux", "3.12.4")) == "/d/environment-1/lib/python3.12/site-packages"


def test_the_state_is_read_as_it_was_written(tmp_path: Path) -> None:
    made = state.State(
        "environment-1a", "lock", "1.0", "3.12.1", "/usr/bin/python3", ("numba",), "screening-2b", "other"
    )
    state.write(tmp_path, made)
    assert state.read(tmp_path) == made
    assert os.listdir(tmp_path) == ["engine.json"]


@pytest.mark.parametrize(
    "change",
    [
        {"environment": "../../elsewhere"},
        {"environment": "environment-../x"},
        {"screening": "screening-a/../../x"},
        {"format": 2},
        {"missing": 5},
        {"environment": 5},
        None,
    ],
)
def test_a_state_that_is_damaged_or_leads_elsewhere_is_none(tmp_path: Path, change: dict[str, object] | None) -> None:
    state.write(tmp_path, state.State("environment-1a", "lock", "1.0", "3.12.1", "python3"))
    path = tmp_path / "engine.json"
    path.write_text("{" if change is None else json.dumps({**json.loads(path.read_text()), **change}))
    assert state.read(tmp_path) is None


def test_the_locks_of_the_zip() -> None:
    engine, screening = read_lock(ENGINE_LOCK), read_lock(SCREENING_LOCK)
    names = {one.name for one in engine}
    assert engine[0].name == "pip"
    assert names >= {"numpy", "rasterio", "numba", "shapely", "lazrs"}
    assert not names & {"torch", "pytest", "mypy", "dask"}
    assert {one.name for one in screening} >= {"torch"}
    assert not names & {one.name for one in screening}
    assert all(one.hashes for one in (*engine, *screening))
    cpu = [one for one in screening if one.index]
    assert [(one.title, one.marker) for one in cpu] == [("torch 2.13.0+cpu", "sys_platform == 'linux'")]


def test_a_lock_with_a_line_that_is_none_is_refused(tmp_path: Path) -> None:
    (tmp_path / "lock").write_text("numpy==2.0 \\\n    --hash=sha256:" + "0" * 64 + "\nscipy>=1.0\n")
    with pytest.raises(ValueError, match=r"lock has a line that is not understood: scipy>=1\.0"):
        read_lock(tmp_path / "lock")


PROXY = {"enabled": "true", "type": "HttpProxy", "host": "proxy.lan", "port": "8080"}


@pytest.mark.parametrize(
    ("settings", "expected"),
    [
        (PROXY, "http://proxy.lan:8080"),
        ({**PROXY, "user": "ana", "password": "p@ss:1"}, "http://ana:p%40ss%3A1@proxy.lan:8080"),
        ({**PROXY, "user": "ana"}, "http://ana@proxy.lan:8080"),
        ({**PROXY, "type": "Socks5Proxy"}, "socks5h://proxy.lan:8080"),
        ({**PROXY, "type": "HttpCachingProxy", "port": ""}, "http://proxy.lan"),
    ],
)
def test_qgis_proxy_reaches_pip(settings: dict[str, str], expected: str) -> None:
    environ = pip_environment({"https_proxy": "http://other:1", "PATH": "/bin"}, proxy_variables(settings))
    assert environ["HTTPS_PROXY"] == environ["HTTP_PROXY"] == expected
    assert "https_proxy" not in environ, "QGIS's proxy counts"
    assert environ["PATH"] == "/bin"


@pytest.mark.parametrize("change", [{"enabled": "false"}, {"host": ""}, {"type": "DefaultProxy"}])
def test_without_a_proxy_in_qgis_that_of_the_environment_counts(change: dict[str, str]) -> None:
    environ = pip_environment({"HTTPS_PROXY": "http://other:1"}, proxy_variables({**PROXY, **change}))
    assert environ["HTTPS_PROXY"] == "http://other:1"


def test_addresses_without_the_proxy() -> None:
    found = proxy_variables({**PROXY, "noProxyUrls": "https://intern.lan/simple\nlocalhost\n"})
    assert found["NO_PROXY"] == "intern.lan,localhost"


def test_the_users_own_pip_is_kept_but_not_where_it_would_install_elsewhere() -> None:
    environ = pip_environment({"PIP_INDEX_URL": "https://intern.lan", "PIP_TARGET": "/x", "pip_prefix": "/y"}, {})
    assert environ["PIP_INDEX_URL"] == "https://intern.lan"
    assert not {"PIP_TARGET", "pip_prefix"} & set(environ)
    assert environ["PIP_USER"] == "0"


def test_no_password_in_the_log() -> None:
    assert without_passwords("via http://ana:secret@proxy:1 to https://pypi.org") == (
        "via http://ana:***@proxy:1 to https://pypi.org"
    )


@pytest.mark.skipif(sys.platform != "linux", reason="processes are looked for in /proc")
def test_a_child_and_its_children_end_when_the_user_cancels(tmp_path: Path) -> None:
    text = (
        "import subprocess, sys, time, pathlib\n"
        "child = subprocess.Popen([sys.executable, '-c', 'import time; time.sleep(600)'])\n"
        f"pathlib.Path({str(tmp_path / 'pid')!r}).write_text(str(child.pid))\n"
        "print('ready', flush=True)\ntime.sleep(600)\n"
    )
    lines: list[str] = []
    started = time.monotonic()
    with pytest.raises(SetupCancelledError):
        run_child([sys.executable, "-c", text], os.environ, lines.append, lambda: bool(lines))
    assert time.monotonic() - started < 60
    pid = int((tmp_path / "pid").read_text())
    for _ in range(200):
        try:
            state_letter = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]
        except OSError:
            break
        if state_letter == "Z":
            break
        time.sleep(0.05)
    else:
        pytest.fail("the child's child lives on")


def test_a_child_gives_its_lines_in_order_and_its_code() -> None:
    lines: list[str] = []
    text = "import sys\nfor n in range(500): print(n, flush=True)\nsys.stderr.write('é last\\n')\nsys.exit(3)\n"
    environ = {**os.environ, "PYTHONUTF8": "1"}
    assert run_child([sys.executable, "-c", text], environ, lines.append, lambda: False) == 3
    assert lines == [*map(str, range(500)), "é last"]


@pytest.mark.skipif(os.name != "posix", reason="environments of Windows hold no links")
def test_an_environment_whose_python_was_upgraded_is_broken(tmp_path: Path) -> None:
    system, environment = tmp_path / "usr", tmp_path / "environment-1a"
    for folder in (system, environment / "bin"):
        folder.mkdir(parents=True)
    for name in ("python3.11", "python3.13"):
        (system / name).write_text("")
    (system / "python3").symlink_to("python3.11")
    (environment / "bin" / "python").symlink_to(system / "python3")
    (environment / "pyvenv.cfg").write_text(f"home = {system}\n")
    state.write(tmp_path, state.State("environment-1a", state.digest(ENGINE_LOCK), "1.0", "3.11.2", "python3"))
    assert state.condition(tmp_path, ENGINE_LOCK, "1.0") is state.Condition.READY
    (system / "python3").unlink()
    (system / "python3").symlink_to("python3.13")
    assert state.condition(tmp_path, ENGINE_LOCK, "1.0") is state.Condition.BROKEN
