"""Building the engine from an index of tiny wheels: whole, cancelled, resumed, repaired, updated, two at once."""

from __future__ import annotations

import os
import subprocess
import sys
import zipfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import pytest
from slopewatch.interface.file_lock import attempt
from slopewatch.plugin.bridge.interpreter import child_environment, find_interpreter
from slopewatch.plugin.bridge.setup import places, state
from slopewatch.plugin.bridge.setup.building import set_up
from slopewatch.plugin.bridge.setup.children import run_child
from slopewatch.plugin.bridge.setup.network import pip_environment
from slopewatch.plugin.bridge.setup.pip import Pip
from slopewatch.plugin.bridge.setup.problems import SetupCancelledError, SetupError
from slopewatch.plugin.bridge.setup.requirements import read_lock
from slopewatch.plugin.bridge.setup.workshop import Order
from slopewatch.tests.builders.engine_setup import Listener, entry, make_lock, make_order, make_plugin, make_wheel


@pytest.fixture
def order(tmp_path: Path) -> Order:
    """Of a plugin 1.0.0 with two packages, and a third that is for no system here."""
    make_plugin(tmp_path / "plugin")
    wheels = [make_wheel(tmp_path / "index", name, "1.0") for name in ("tiny_one", "tiny_two")]
    elsewhere = make_wheel(tmp_path / "other", "tiny_three", "1.0")
    lock = make_lock(
        tmp_path / "engine.lock",
        *map(entry, wheels),
        entry(elsewhere, "sys_platform == 'none'"),
    )
    return make_order(tmp_path, tmp_path / "index", lock)


@pytest.fixture(scope="session")
def bundled_pip() -> Path:
    """The wheel of pip that comes with Python (Debian keeps it elsewhere)."""
    ensurepip = pytest.importorskip("ensurepip")
    places = [Path(ensurepip.__file__).parent / "_bundled", Path("/usr/share/python-wheels")]
    wheel = next((wheel for place in places for wheel in place.glob("pip-*.whl")), None)
    if wheel is None:
        pytest.skip("this Python has no wheel of pip")
    return wheel


@pytest.fixture(scope="session")
def unpacked_pip(tmp_path_factory: pytest.TempPathFactory, bundled_pip: Path) -> Path:
    folder = tmp_path_factory.mktemp("pip")
    zipfile.ZipFile(bundled_pip).extractall(folder)
    return folder


@pytest.fixture
def fast(monkeypatch: pytest.MonkeyPatch, unpacked_pip: Path) -> None:
    """Environments that lead to one pip, as installing it takes more time than all else that is tested here."""

    def start(self: Pip, installer: object) -> None:
        packages = next(self.python.parents[1].rglob("site-packages"))
        (packages / "pip.pth").write_text(f"{unpacked_pip}\n")

    monkeypatch.setattr(Pip, "start", start)


def names(folder: Path) -> list[str]:
    """What is in the data folder, built folders by how their names begin."""
    return sorted(name.partition("-")[0] if "-" in name else name for name in os.listdir(folder))


BUILT = ["engine.json", "environment", "set", "set"]  # the two sets are lock and log


def engine(order: Order, **variables: str) -> str:
    """What the engine says that is in use."""
    python, how = find_interpreter("", order.root, {}, order.root)
    assert how == "the set-up"
    environ = {**child_environment(), "SLOPEWATCH_FOLDER": str(order.plugin), **variables}
    command = [str(python), "-m", "slopewatch.cli"]
    return subprocess.run(command, env=environ, check=True, capture_output=True, text=True).stdout


def test_from_nothing_to_an_engine_then_repaired_updated_and_moved(order: Order, tmp_path: Path) -> None:
    """One story, as each build takes seconds."""
    assert state.condition(order.root, order.engine_lock, "1.0.0") is state.Condition.MISSING
    heard = Listener()
    first = set_up(order, heard.reporter())
    assert '"slopewatch": "1.0.0", "two": 1' in engine(order)
    assert names(order.root) == BUILT
    assert heard.percents == sorted(heard.percents)
    assert heard.percents[-1] == 100
    assert "Downloading tiny-two 1.0 (2 of 2)" in heard.words
    assert state.condition(order.root, order.engine_lock, "1.0.0") is state.Condition.READY
    log = (order.root / places.LOG).read_text(encoding="utf-8")
    assert "-m venv --without-pip" in log
    assert "Successfully installed tiny-one-1.0 tiny-two-1.0" in log

    # a second time: nothing to do, and no index needed
    again = set_up(replace(order, pip_environ={}), Listener().reporter())
    assert again == first

    # repaired: a new one, the old is gone
    (order.root / first.environment / "pyvenv.cfg").unlink()
    assert state.condition(order.root, order.engine_lock, "1.0.0") is state.Condition.BROKEN
    repaired = set_up(replace(order, repair=True), Listener().reporter())
    assert repaired.environment != first.environment
    assert names(order.root) == BUILT
    assert '"two": 1' in engine(order)

    # the plugin is updated, with another lock; what fails leaves the old one in use
    make_plugin(tmp_path / "plugin", "1.1.0")
    new = make_wheel(tmp_path / "index", "tiny_two", "2.0", "VALUE = 2\n")
    lock = make_lock(tmp_path / "engine.lock", entry(tmp_path / "index" / "tiny_one-1.0-py3-none-any.whl"), entry(new))
    newer = replace(order, version="1.1.0", engine_lock=lock)
    assert state.condition(order.root, lock, "1.1.0") is state.Condition.OUTDATED
    assert state.condition(order.root, lock, "0.9.0") is state.Condition.READY, "an older plugin takes the newer engine"
    new.rename(tmp_path / "hidden.whl")
    with pytest.raises(SetupError, match=r"^Downloading tiny-two 2\.0 failed: there is no ready build"):
        set_up(newer, Listener().reporter())
    assert '"two": 1' in engine(order)
    assert names(order.root) == ["downloads", *BUILT]
    (tmp_path / "hidden.whl").rename(new)
    updated = set_up(newer, Listener().reporter())
    assert updated.plugin == "1.1.0"
    assert '"slopewatch": "1.1.0", "two": 2' in engine(order)
    assert names(order.root) == BUILT

    # the profile moves: the plugin names its new folder; without that the engine says what to do
    moved = (tmp_path / "plugin").rename(tmp_path / "moved")
    assert '"1.1.0"' in engine(replace(newer, plugin=moved))
    with pytest.raises(subprocess.CalledProcessError) as caught:
        engine(newer)
    assert "plugin is no longer in" in caught.value.stderr
    set_up(replace(newer, plugin=moved), Listener().reporter())
    assert '"1.1.0"' in engine(newer, SLOPEWATCH_FOLDER=""), "the folder is kept for the command line"


@pytest.mark.usefixtures("fast")
def test_cancelled_while_it_downloads_and_gone_on_with(order: Order, tmp_path: Path) -> None:
    heard = Listener(cancel_at="Downloading tiny-two")
    with pytest.raises(SetupCancelledError, match=r"^Cancelled; the engine is as it was"):
        set_up(order, heard.reporter())
    assert names(order.root) == ["downloads", "set", "set"]
    (kept,) = (order.root / "downloads").rglob("*.whl")
    assert kept.name.startswith("tiny_one")
    # what was downloaded is not asked for again; what was cut short is
    (tmp_path / "index" / "tiny_one-1.0-py3-none-any.whl").unlink()
    cut = kept.with_name("tiny_two-1.0-py3-none-any.whl")
    cut.write_bytes(b"half a file")
    # what a killed set-up left goes
    (order.root / "environment-killed").mkdir()
    set_up(order, Listener().reporter())
    assert names(order.root) == BUILT
    assert '"two": 1' in engine(order)


@pytest.mark.usefixtures("fast")
@pytest.mark.parametrize("words", ["Looking for a Python", "Installing pip", "Installing packages"])
def test_cancelled_at_any_step_it_leaves_nothing(order: Order, words: str) -> None:
    with pytest.raises(SetupCancelledError):
        set_up(order, Listener(cancel_at=words).reporter())
    assert [name for name in names(order.root) if name != "downloads"] == ["set", "set"]


@pytest.mark.usefixtures("fast")
def test_another_file_than_the_tested_one_is_refused(order: Order, tmp_path: Path) -> None:
    make_wheel(tmp_path / "index", "tiny_two", "1.0", "VALUE = 'another'\n")
    with pytest.raises(SetupError, match="is not the one that this version of SlopeWatch was tested with"):
        set_up(order, Listener().reporter())
    assert not (order.root / places.STATE).exists()


@pytest.mark.usefixtures("fast")
def test_an_engine_that_does_not_start_is_not_used(order: Order, tmp_path: Path) -> None:
    (tmp_path / "plugin" / "cli" / "__main__.py").write_text("import tiny_four\n")
    with pytest.raises(SetupError, match=r"^Checking the engine failed \(.*No module named 'tiny_four'"):
        set_up(order, Listener().reporter())
    assert [name for name in names(order.root) if name != "downloads"] == ["set", "set"]


@pytest.mark.usefixtures("fast")
def test_an_optional_package_without_a_build_is_done_without(order: Order, tmp_path: Path) -> None:
    foreign = make_wheel(tmp_path / "index", "numba", "1.0", tag="cp27-cp27m-win32")
    text = order.engine_lock.read_text() + entry(foreign)
    order.engine_lock.write_text(text)
    heard = Listener()
    made = set_up(order, heard.reporter())
    assert made.missing == ("numba",)
    assert heard.warnings == [
        "Downloading numba 1.0 failed: there is no ready build of it for this system and this Python."
    ]


@pytest.mark.usefixtures("fast")
def test_from_a_folder_of_wheels_without_a_network(order: Order, tmp_path: Path) -> None:
    offline = {**order.pip_environ, "PIP_INDEX_URL": "http://127.0.0.1:9/simple", "PIP_FIND_LINKS": ""}
    offline.pop("PIP_NO_INDEX")
    set_up(replace(order, pip_environ=offline, wheels=tmp_path / "index"), Listener().reporter())
    assert '"two": 1' in engine(order)


@pytest.mark.usefixtures("fast")
def test_two_at_once(order: Order) -> None:
    order.root.mkdir()
    with attempt(order.root / places.LOCK), pytest.raises(SetupError, match=r"^Another QGIS is setting the engine up"):
        set_up(order, Listener().reporter())
    assert names(order.root) == ["set"]


@pytest.mark.usefixtures("fast")
def test_a_full_disk_is_said_before_anything_is_begun(order: Order) -> None:
    with pytest.raises(SetupError, match=r"is full; make room for 1000000\.0 GB \(there are \d+\.\d GB\), or name"):
        set_up(replace(order, engine_bytes=10**15), Listener().reporter())
    assert names(order.root) == ["set", "set"]


@pytest.mark.usefixtures("fast")
@pytest.mark.skipif(sys.platform == "win32" or os.geteuid() == 0, reason="root may write anywhere")
def test_a_locked_folder(order: Order) -> None:
    order.root.mkdir(mode=0o500)
    with pytest.raises(SetupError, match=r"^The set-up may not write to .*name another folder"):
        set_up(order, Listener().reporter())


@pytest.mark.usefixtures("fast")
def test_a_file_where_the_folder_should_be(order: Order) -> None:
    order.root.write_text("")
    with pytest.raises(SetupError, match=r"^The set-up cannot work in .*name another folder"):
        set_up(order, Listener().reporter())


@pytest.mark.skipif(os.name != "posix", reason="a shell script stands for Python")
@pytest.mark.usefixtures("fast")
def test_without_a_python_it_says_which_were_refused(order: Order, tmp_path: Path) -> None:
    old = tmp_path / "python3.8"
    answer = '{"version": "3.8.18", "bits": 64, "executable": "x", "venv": true, "tag": "cpython-38"}'
    old.write_text(f"#!/bin/sh\necho '{answer}'\n")
    old.chmod(0o755)
    with pytest.raises(SetupError, match=r"Python 3\.8\.18 at .* is too old; .*nowhere does not start.*install Python"):
        set_up(replace(order, pythons=[((str(old),), "here"), (("/nowhere",), "there")]), Listener().reporter())
    assert names(order.root) == ["set", "set"]


@pytest.mark.skipif(os.name != "posix", reason="a shell script stands for Python")
@pytest.mark.usefixtures("fast")
def test_a_python_that_makes_no_sound_environment_is_passed_over(order: Order, tmp_path: Path) -> None:
    """As those in QGIS's bundle for macOS can be."""
    broken = tmp_path / "python3"
    answer = f'{{"version": "3.12.1", "bits": 64, "executable": "{broken}", "venv": true, "tag": "t"}}'
    broken.write_text(f"#!/bin/sh\nif [ \"$3\" = venv ]; then exit 1; fi\necho '{answer}'\n")
    broken.chmod(0o755)
    made = set_up(replace(order, pythons=[((str(broken),), "the bundle"), *order.pythons]), Listener().reporter())
    assert made.base != str(broken)


@pytest.mark.usefixtures("fast")
def test_the_networks_packages_come_and_go_without_the_engine(order: Order, tmp_path: Path) -> None:
    torch = make_wheel(tmp_path / "index", "torch", "1.0", "__version__ = '1.0'\n")
    safetensors = make_wheel(tmp_path / "index", "safetensors", "1.0")
    lock = make_lock(tmp_path / "screening.lock", entry(torch), entry(safetensors))
    order = replace(order, screening_lock=lock)
    before = set_up(order, Listener().reporter())
    broken = make_wheel(tmp_path / "index", "torch", "1.0", "raise OSError('no such library')\n")
    make_lock(lock, entry(broken), entry(safetensors))
    with pytest.raises(SetupError, match=r"^Checking PyTorch failed \(.*no such library"):
        set_up(replace(order, screening=True), Listener().reporter())
    assert state.read(order.root) == before
    make_wheel(tmp_path / "index", "torch", "1.0", "__version__ = '1.0'\n")
    make_lock(lock, entry(torch), entry(safetensors))
    made = set_up(replace(order, screening=True), Listener().reporter())
    assert made.environment == before.environment
    assert made.screening in engine(order)
    # an engine built anew for the same Python keeps them
    repaired = set_up(replace(order, repair=True), Listener().reporter())
    assert (repaired.environment != made.environment, repaired.screening) == (True, made.screening)
    assert made.screening in engine(order)
    order.root.rename(tmp_path / "moved data")
    assert f"moved data/{made.screening}" in engine(replace(order, root=tmp_path / "moved data")).replace("\\\\", "/")


def test_a_python_without_its_own_pip_gets_it_from_the_index(tmp_path: Path, bundled_pip: Path) -> None:
    """As Debian's without python3-venv."""
    environment = tmp_path / "environment"
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", str(environment)], check=True)
    asked: list[str] = []

    def fetch(address: str) -> bytes:
        asked.append(address)
        if address.endswith("/pip/"):
            return f'<a href="../../files/{bundled_pip.name}#sha256=0">it</a>'.encode()
        return bundled_pip.read_bytes()

    def run(command: Sequence[str], environ: Mapping[str, str], take: Callable[[str], None]) -> int:
        return 1 if "ensurepip" in command else run_child(command, environ, take, lambda: False)

    def failed(lines: Sequence[str], task: str) -> SetupError:
        return SetupError("\n".join(lines))

    (wanted,) = read_lock(make_lock(tmp_path / "lock", entry(bundled_pip)))
    environ = {**pip_environment(child_environment(), {}), "PIP_INDEX_URL": "https://intern.lan/simple/"}
    python = Path(places.interpreter_in(environment, sys.platform))
    pip = Pip(python, run, environ, tmp_path / "wheels", None, failed, fetch)
    pip.start(wanted)
    assert pip.version() == wanted.version
    assert asked == ["https://intern.lan/simple/pip/", f"https://intern.lan/files/{bundled_pip.name}"]
    # another file than that of the lock is refused
    bad = replace(wanted, hashes=frozenset(["0" * 64]))
    with pytest.raises(SetupError, match="DO NOT MATCH"):
        Pip(python, run, environ, tmp_path / "others", None, failed, fetch).start(bad)
    assert list((tmp_path / "others").iterdir()) == []
