"""What the tests in QGIS's interpreter share: a recording feedback, an engine that does as scripted, qgis_process."""

from __future__ import annotations

import json
import os
import signal
import stat
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from qgis.core import QgsApplication, QgsProcessingFeedback
from slopewatch.tests.builders.limits import PATIENCE_S

ROOT = Path(__file__).resolve().parents[2]


class Recorder(QgsProcessingFeedback):
    """Keeps what an algorithm reports."""

    def __init__(self) -> None:
        super().__init__(False)
        self.lines: list[tuple[str, str]] = []
        self.percents: list[float] = []
        self.progressChanged.connect(self.percents.append)

    def said(self, kind: str) -> list[str]:
        return [text for k, text in self.lines if k == kind]

    def pushInfo(self, info: str) -> None:
        self.lines.append(("info", info))

    def pushWarning(self, warning: str) -> None:
        self.lines.append(("warning", warning))

    def pushDebugInfo(self, info: str) -> None:
        self.lines.append(("debug", info))

    def pushCommandInfo(self, info: str) -> None:
        self.lines.append(("command", info))

    def setProgressText(self, text: str) -> None:
        self.lines.append(("stage", text))

    def reportError(self, error: str, fatalError: bool = False) -> None:
        self.lines.append(("error", error))


@pytest.fixture
def feedback() -> Recorder:
    return Recorder()


# A shell's first lines that Python reads as a string, so that a blank in the checkout's path does no harm.
FAKE_HEAD = """#!/bin/sh
'''exec' "{python}" "$0" "$@"
' '''
import json, os, signal, subprocess, sys, time
os.setsid()  # as the engine with --watch-parent
def say(**event):
    print(json.dumps(event), flush=True)
def value(option):
    return sys.argv[sys.argv.index(option) + 1]
"""


@pytest.fixture
def fake_engine(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[[str], Path]:
    """Makes an interpreter that runs the given lines instead of the engine, and has the plugin use it.

    In the lines, ``sys.argv`` is what the engine would get after ``-m slopewatch.cli``, ``say(...)`` prints an
    event and ``value("--roi")`` is an option's value.
    """

    def make(body: str) -> Path:
        path = tmp_path / "fake-engine" / "python"
        path.parent.mkdir(exist_ok=True)
        check = "assert sys.argv[1:3] == ['-m', 'slopewatch.cli'], sys.argv\ndel sys.argv[1:3]\n"
        path.write_text(FAKE_HEAD.format(python=sys.executable) + check + body)
        path.chmod(path.stat().st_mode | stat.S_IXUSR)
        monkeypatch.setenv("SLOPEWATCH_PYTHON", str(path))
        return path

    return make


@pytest.fixture
def provider(qgis_app: QgsApplication) -> Any:
    """The provider, registered as QGIS does it through the plugin."""
    import slopewatch

    plugin = slopewatch.classFactory(None)
    plugin.initProcessing()
    yield QgsApplication.processingRegistry().providerById("slopewatch")
    plugin.unload()


def processes_with(text: str) -> list[int]:
    """Living processes whose command line holds ``text``."""
    found = []
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit() and int(entry.name) != os.getpid():
            try:
                command = (entry / "cmdline").read_bytes()
                state = (entry / "stat").read_text().rpartition(")")[2].split()[0]
            except OSError:
                continue
            if text.encode() in command and state != "Z":
                found.append(int(entry.name))
    return found


def wait_until(condition: Callable[[], Any], seconds: float = PATIENCE_S) -> Any:
    """The first true value of ``condition`` within the time; fails the test without one."""
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        found = condition()
        if found:
            return found
        time.sleep(0.02)
    pytest.fail(f"did not happen within {seconds} s")


def engine_python() -> Path:
    """The interpreter of the real engine; the test is skipped where there is none."""
    from slopewatch.plugin.bridge.interpreter import InterpreterNotFoundError, find_interpreter

    try:
        return find_interpreter()[0]
    except InterpreterNotFoundError as error:
        pytest.skip(str(error))


class QgisProcess:
    """The real qgis_process with the plugin in a private profile."""

    def __init__(self, folder: Path, plugin: Path = ROOT) -> None:
        plugins = folder / "plugins"
        plugins.mkdir(parents=True)
        (plugins / "slopewatch").symlink_to(plugin)
        self.environment = {
            **{k: v for k, v in os.environ.items() if k != "PYTHONPATH"},
            # QGIS finds its Python's libraries by the first python3 on the path, which must be the system's
            "PATH": os.pathsep.join(["/usr/bin", "/bin", os.environ.get("PATH", "")]),
            "QT_QPA_PLATFORM": "offscreen",
            "QGIS_PLUGINPATH": str(plugins),
            "QGIS_CUSTOM_CONFIG_PATH": str(folder / "profile"),
            "XDG_RUNTIME_DIR": str(folder),
        }
        done = self("plugins", "enable", "slopewatch")
        assert done.returncode == 0, done.stderr

    def __call__(self, *arguments: str, **variables: str) -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            ["qgis_process", *arguments],
            env={**self.environment, **variables},
            capture_output=True,
            text=True,
            timeout=600,
            check=False,
        )

    def run(self, algorithm: str, **parameters: Any) -> dict[str, Any]:
        """Run to the end with ``--json`` and give the results."""
        done = self.attempt(algorithm, **parameters)
        assert done.returncode == 0, done.stderr[-3000:]
        return json.loads(done.stdout)["results"]

    def attempt(self, algorithm: str, **parameters: Any) -> subprocess.CompletedProcess[str]:
        """Run it; a parameter that takes several values gets a list of them."""
        several = {name: value if isinstance(value, list) else [value] for name, value in parameters.items()}
        given = [f"--{name}={value}" for name, values in several.items() for value in values]
        return self("--json", "run", f"slopewatch:{algorithm}", *given)

    def start(self, algorithm: str, **parameters: Any) -> subprocess.Popen[str]:
        given = [f"--{name}={value}" for name, value in parameters.items()]
        return subprocess.Popen(
            ["qgis_process", "run", f"slopewatch:{algorithm}", *given],
            env=self.environment,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,
            preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
        )


@pytest.fixture(scope="session")
def qgis_process(tmp_path_factory: pytest.TempPathFactory) -> QgisProcess:
    return QgisProcess(tmp_path_factory.mktemp("qgis"))


@pytest.fixture(scope="session")
def survey(qgis_process: QgisProcess, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """A small simulated pair, made through qgis_process: the algorithm's results."""
    engine_python()
    folder = tmp_path_factory.mktemp("survey") / "pair, of 'surveys'"
    size = {"POINTS": 60000, "LENGTH": 24, "HEIGHT": 10, "VEGETATION": 0.4}
    return qgis_process.run("simulatesurvey", OUTPUT_FOLDER=folder, **size)


def load_results(algorithm: Any, context: Any, feedback: Any, parameters: dict[str, Any]) -> bool:
    """QGIS's own loading of an algorithm's results, without a window: its stand-in has no tree of layers."""
    from processing.gui import Postprocessing

    Postprocessing.iface = None
    return bool(Postprocessing.handleAlgorithmResults(algorithm, context, feedback, parameters))
