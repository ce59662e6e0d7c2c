"""The client against an engine that behaves as scripted: well, badly, and not at all."""

from __future__ import annotations

import os
import signal
import threading
import time
from collections.abc import Callable
from pathlib import Path

import pytest
from qgis.core import QgsApplication
from qgis.PyQt.QtCore import QTimer
from slopewatch.plugin.bridge import engine_client, settings
from slopewatch.plugin.bridge.engine_client import (
    EngineCancelledError,
    EngineCrashedError,
    EngineInputError,
    EngineKilledError,
    EngineNotFoundError,
    EngineNotStartedError,
    run_engine,
)
from slopewatch.tests.builders.limits import CANCELLED_S
from slopewatch.tests.builders.qgis import Recorder, processes_with, wait_until

Fake = Callable[[str], Path]


def test_a_good_run_is_passed_on(fake_engine: Fake, feedback: Recorder, tmp_path: Path) -> None:
    output = tmp_path / "a b.laz"
    fake_engine(
        f"""
say(event="progress", percent=10, message="reading")
say(event="log", level="info", message="two epochs")
say(event="log", level="warning", message="little stable ground")
say(event="progress", percent=60.5, message="reading")
say(event="progress", percent=90, message="writing")
open({str(output)!r}, "w").close()
figures = {{"ground_points": 7, "args": sys.argv[1:]}}
say(event="result", outputs={{"ground": {str(output)!r}, "nothing": None}}, metrics=figures)
"""
    )
    result = run_engine(["ground", "cloud, 'of' ä.laz", "--output", str(output)], feedback)
    assert result.outputs == {"ground": str(output)}
    assert result.metrics["ground_points"] == 7
    assert result.metrics["args"] == [
        "ground",
        "cloud, 'of' ä.laz",
        "--output",
        str(output),
        "--progress",
        "json",
        "--watch-parent",
    ]
    assert feedback.percents == [10.0, 60.5, 90.0]
    assert feedback.said("stage") == ["Reading", "Writing"]
    assert feedback.said("info") == ["two epochs"]
    assert feedback.said("warning") == ["little stable ground"]


def test_a_batch_of_which_slopes_failed_has_a_result_and_a_warning(fake_engine: Fake, feedback: Recorder) -> None:
    fake_engine("say(event='result', outputs={}, metrics={'slopes_done': 1})\nsys.exit(3)")
    assert run_engine(["batch"], feedback).metrics == {"slopes_done": 1}
    assert feedback.said("warning") == ["Some slopes failed; the others have their results."]


def test_lines_outside_the_protocol_do_no_harm(fake_engine: Fake, feedback: Recorder) -> None:
    fake_engine(
        """
out = sys.stdout.buffer
out.write(b"\\xff\\xfe not text\\n\\n[1, 2]\\n17\\nnull\\n")
out.write(b'{"event": "progress"}\\n{"event": "new kind"}\\n{"percent"\\n')
out.write(b"[" * 100000 + b"\\n")
out.write(b"x" * 3000000 + b"\\n")
out.flush()
say(event="progress", percent="NaN", message=None)
say(event="progress", percent=1e9, message="over")
say(event="result", outputs={}, metrics={"ok": True})
"""
    )
    assert run_engine(["check"], feedback).metrics == {"ok": True}
    assert any("not text" in line for line in feedback.said("debug"))
    assert all(0 <= p <= 100 for p in feedback.percents)


def test_much_on_standard_error_does_not_block(fake_engine: Fake, feedback: Recorder) -> None:
    fake_engine("sys.stderr.write('warning\\n' * 2000000)\nsay(event='result', outputs={}, metrics={'done': 1})\n")
    assert run_engine(["check"], feedback).metrics == {"done": 1}


def test_input_error_keeps_the_engines_sentence(fake_engine: Fake, feedback: Recorder) -> None:
    sentence = "cloud.laz does not exist; check the path."
    fake_engine(
        f"say(event='error', message={sentence!r}, code=2)\n"
        f"print('Error: ' + {sentence!r}, file=sys.stderr)\nsys.exit(2)"
    )
    with pytest.raises(EngineInputError) as caught:
        run_engine(["ground", "cloud.laz"], feedback)
    assert str(caught.value) == sentence


def test_refused_options_show_the_last_line(fake_engine: Fake, feedback: Recorder) -> None:
    fake_engine("print('Usage: slopewatch\\n\\nError: No such option: --x', file=sys.stderr)\nsys.exit(2)")
    with pytest.raises(EngineInputError, match=r"^No such option: --x$"):
        run_engine(["ground"], feedback)


@pytest.mark.parametrize(
    ("body", "error", "words"),
    [
        ("say(event='progress', percent=1)\nos.kill(os.getpid(), signal.SIGKILL)", EngineKilledError, "memory ran out"),
        ("os.kill(os.getpid(), signal.SIGSEGV)", EngineCrashedError, r"crashed with code -11 \(SIGSEGV\)"),
        ("say(event='progress', percent=1)\nsys.exit(77)", EngineCrashedError, "crashed with code 77"),
        ("say(event='error', message='CSF failed.', code=1)\nsys.exit(1)", EngineCrashedError, "failed: CSF failed."),
        ("print('ImportError: libgdal.so', file=sys.stderr)\nsys.exit(1)", EngineNotStartedError, "libgdal.so"),
        (
            "print(\"No module named 'slopewatch'\", file=sys.stderr)\nsys.exit(1)",
            EngineNotStartedError,
            "not installed",
        ),
        ("pass", EngineCrashedError, "without a result"),
        ("sys.exit(3)", EngineCrashedError, "without a result"),
        ("say(event='result', outputs={'a': '/nowhere/a.tif'}, metrics={})", EngineCrashedError, "/nowhere/a.tif"),
        ("sys.exit(130)", EngineCancelledError, "interrupted"),
    ],
)
def test_each_failure_has_its_own_message(
    fake_engine: Fake, feedback: Recorder, body: str, error: type[Exception], words: str
) -> None:
    fake_engine(body)
    with pytest.raises(error, match=words):
        run_engine(["check"], feedback)


def test_no_interpreter(monkeypatch: pytest.MonkeyPatch, feedback: Recorder, tmp_path: Path) -> None:
    monkeypatch.setenv("SLOPEWATCH_PYTHON", str(tmp_path / "none"))
    with pytest.raises(EngineNotFoundError, match="SLOPEWATCH_PYTHON"):
        run_engine(["check"], feedback)


def test_interpreter_that_is_no_program(monkeypatch: pytest.MonkeyPatch, feedback: Recorder, tmp_path: Path) -> None:
    (tmp_path / "text").write_text("not a program")
    monkeypatch.setenv("SLOPEWATCH_PYTHON", str(tmp_path / "text"))
    with pytest.raises(EngineNotStartedError, match="cannot be started"):
        run_engine(["check"], feedback)


def test_the_pdal_setting_reaches_the_engine(fake_engine: Fake, feedback: Recorder, qgis_app: QgsApplication) -> None:
    fake_engine("say(event='result', outputs={}, metrics={'pdal': value('--pdal')})")
    settings.store(settings.PDAL, "/opt/pdal/bin/pdal")
    try:
        assert run_engine(["check"], feedback).metrics["pdal"] == "/opt/pdal/bin/pdal"
    finally:
        settings.store(settings.PDAL, "")


def test_the_engine_does_not_get_qgis_environment(
    fake_engine: Fake, feedback: Recorder, monkeypatch: pytest.MonkeyPatch
) -> None:
    foreign = ["PYTHONHOME", "PYTHONPATH", "GDAL_DATA", "PROJ_LIB", "PROJ_DATA", "LD_LIBRARY_PATH", "DYLD_LIBRARY_PATH"]
    script = fake_engine("say(event='result', outputs={}, metrics=dict(os.environ))")
    for name in foreign:
        monkeypatch.setenv(name, str(script.parent))
    monkeypatch.setenv("HTTP_PROXY", "kept")
    seen = run_engine(["check"], feedback).metrics
    assert not [name for name in foreign if name in seen]
    assert seen["HTTP_PROXY"] == "kept"
    assert seen["PYTHONUTF8"] == "1"


STUBBORN = """
mark = value("--mark")
for name in (signal.SIGTERM, signal.SIGINT, signal.SIGHUP):
    signal.signal(name, signal.SIG_IGN)
code = "import signal, time; signal.signal(signal.SIGTERM, signal.SIG_IGN); time.sleep(60)"
child = subprocess.Popen([sys.executable, "-c", code, mark])
say(event="progress", percent=1, message="started")
time.sleep(60)
"""


def test_cancel_ends_a_stubborn_engine_and_its_children(fake_engine: Fake, feedback: Recorder, tmp_path: Path) -> None:
    fake_engine(STUBBORN)
    mark = f"mark-{os.getpid()}-{tmp_path.name}"
    pressed: list[float] = []

    def press() -> None:
        wait_until(lambda: feedback.percents and len(processes_with(mark)) >= 2)
        pressed.append(time.monotonic())
        feedback.cancel()

    button = threading.Thread(target=press)
    button.start()
    with pytest.raises(EngineCancelledError, match="no output"):
        run_engine(["check", "--mark", mark], feedback)
    wait_until(lambda: not processes_with(mark), 2.0)
    assert time.monotonic() - pressed[0] < 2.0
    button.join()


def test_cancel_lets_the_engine_clean_up(fake_engine: Fake, feedback: Recorder, tmp_path: Path) -> None:
    fake_engine(
        f"""
signal.signal(signal.SIGTERM, lambda *_: None)
say(event="progress", percent=1, message="started")
sys.stdin.buffer.read()  # until the client closes it
open({str(tmp_path / "cleaned")!r}, "w").close()
sys.exit(130)
"""
    )
    feedback.progressChanged.connect(feedback.cancel)
    with pytest.raises(EngineCancelledError):
        run_engine(["check"], feedback)
    assert (tmp_path / "cleaned").exists()


def test_cancel_while_the_output_is_already_closed(fake_engine: Fake, feedback: Recorder) -> None:
    fake_engine("say(event='progress', percent=1)\nos.close(1)\nos.close(2)\ntime.sleep(60)")
    feedback.progressChanged.connect(lambda _: threading.Timer(0.5, feedback.cancel).start())
    started = time.monotonic()
    with pytest.raises(EngineCancelledError):
        run_engine(["check"], feedback)
    assert time.monotonic() - started < CANCELLED_S


def test_a_child_that_outlives_the_engine_does_not_hold_the_client(
    fake_engine: Fake, feedback: Recorder, tmp_path: Path
) -> None:
    mark = f"mark-{os.getpid()}-{tmp_path.name}"
    fake_engine(
        f"subprocess.Popen([sys.executable, '-c', 'import time; time.sleep(60)', {mark!r}])\n"
        "say(event='result', outputs={}, metrics={'ok': 1})\n"
    )
    started = time.monotonic()
    assert run_engine(["check"], feedback).metrics == {"ok": 1}
    assert time.monotonic() - started < CANCELLED_S
    wait_until(lambda: not processes_with(mark))


def test_the_main_thread_stays_alive(fake_engine: Fake, feedback: Recorder, qgis_app: QgsApplication) -> None:
    """A button pressed in the main thread is heard while the engine runs there."""
    fake_engine("say(event='progress', percent=1)\ntime.sleep(60)")
    QTimer.singleShot(300, feedback.cancel)
    started = time.monotonic()
    with pytest.raises(EngineCancelledError):
        run_engine(["check"], feedback)
    assert time.monotonic() - started < CANCELLED_S


def test_a_cancelled_run_does_not_start(fake_engine: Fake, feedback: Recorder, tmp_path: Path) -> None:
    fake_engine(f"open({str(tmp_path / 'started')!r}, 'w').close()")
    feedback.cancel()
    with pytest.raises(EngineCancelledError):
        run_engine(["check"], feedback)
    assert not (tmp_path / "started").exists()


def test_windows_codes_are_readable() -> None:
    assert engine_client._code_name(0xC0000005) == "3221225477 (0xC0000005)"
    assert engine_client._code_name(-signal.SIGABRT) == "-6 (SIGABRT)"
