"""The process pump against programs that behave badly, in every kind of thread that QGIS runs algorithms in."""

from __future__ import annotations

import itertools
import os
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from qgis.core import QgsApplication, QgsFeedback, QgsTask
from qgis.PyQt.QtCore import QCoreApplication, QEventLoop, QTimer
from slopewatch.plugin.bridge import engine_process
from slopewatch.plugin.bridge.engine_process import Ended, run_process
from slopewatch.tests.builders.qgis import processes_with, wait_until

pytestmark = pytest.mark.usefixtures("qgis_app")
HEAD = "import os, signal, subprocess, sys, time\nout = sys.stdout.buffer\n"
ENDLESS = "print('begun', flush=True)\ntime.sleep(60)"


def run(body: str, take: Callable[[bytes], None] = lambda _: None, feedback: QgsFeedback | None = None) -> Ended:
    environment = {"PATH": os.environ["PATH"]}
    return run_process(
        [sys.executable, "-c", HEAD + body], environment, take, feedback.isCanceled if feedback else lambda: False
    )


def peak_memory() -> int:
    """Peak resident bytes of this process since the last reset."""
    status = Path("/proc/self/status").read_text()
    return 1024 * int(status.partition("VmHWM:")[2].split()[0])


def test_lines_come_one_by_one_and_the_last_needs_no_end() -> None:
    heard: list[tuple[float, bytes]] = []
    ended = run(
        "for word in (b'one', b'two', b'three'):\n out.write(word + b'\\n'); out.flush(); time.sleep(0.4)\n"
        "out.write(b'four')",
        lambda line: heard.append((time.monotonic(), line)),
    )
    assert ended == Ended(0, "", cancelled=False)
    assert [line for _, line in heard] == [b"one", b"two", b"three", b"four"]
    times = [moment for moment, _ in heard]
    assert all(0.2 < later - earlier < 1.0 for earlier, later in itertools.pairwise(times))


def test_the_end_of_standard_error_is_kept() -> None:
    ended = run("sys.stderr.write('x' * 3_000_000 + ' the last words')\nsys.exit(3)")
    assert (ended.code, len(ended.complaint)) == (3, 16384)
    assert ended.complaint.endswith("x the last words")


def test_output_without_an_end_of_line_does_not_fill_the_memory() -> None:
    sizes: list[int] = []
    Path("/proc/self/clear_refs").write_text("5")
    before = peak_memory()
    run("for _ in range(100):\n out.write(b'x' * 1_000_000)", lambda line: sizes.append(len(line)))
    assert sum(sizes) == 100_000_000
    assert max(sizes) < 1_300_000
    assert peak_memory() - before < 30_000_000


def test_the_program_gets_the_given_environment_only() -> None:
    heard: list[bytes] = []
    run("print(sorted(set(os.environ) - {'LC_CTYPE'}))", heard.append)
    assert heard == [b"['PATH']"]


def test_lines_keep_their_order_where_showing_one_lets_events_through() -> None:
    heard: list[int] = []

    def take(line: bytes) -> None:
        until = time.monotonic() + 0.02
        while time.monotonic() < until:
            QCoreApplication.processEvents()
        heard.append(int(line))

    run("for i in range(40):\n print(i, flush=True); time.sleep(0.01)", take)
    assert heard == list(range(40))


@pytest.mark.parametrize("kind", [ValueError, KeyboardInterrupt])
def test_what_a_listener_raises_ends_the_program_and_is_raised(kind: type[BaseException], tmp_path: Path) -> None:
    def take(line: bytes) -> None:
        raise kind("not now")

    started = time.monotonic()
    with pytest.raises(kind, match="not now"):
        run(f"mark = {str(tmp_path)!r}\n{ENDLESS}", take)
    assert time.monotonic() - started < 4.0
    wait_until(lambda: not processes_with(str(tmp_path)), 1.0)


def test_a_program_that_writes_without_end_is_cancelled() -> None:
    feedback = QgsFeedback()
    QTimer.singleShot(300, feedback.cancel)
    started = time.monotonic()
    ended = run(
        "signal.signal(signal.SIGTERM, signal.SIG_IGN)\nwhile True: out.write(b'x\\n' * 1000)", feedback=feedback
    )
    assert ended.cancelled
    assert time.monotonic() - started < 2.8


QUITTING = """
import sys
from qgis.PyQt.QtCore import QCoreApplication, QTimer
from engine_process import run_process
application = QCoreApplication([])
def take(line):
    QTimer.singleShot(0, lambda: QCoreApplication.exit(0))  # ends every loop of the main thread, for good
command = [sys.executable, "-c", "import time; print(1, flush=True); time.sleep(60)", sys.argv[1]]
print(run_process(command, {}, take, lambda: False).cancelled)
"""


def test_a_loop_that_qgis_ends_on_quitting_is_a_cancel(tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-c", QUITTING, str(tmp_path)],
        env={**os.environ, "PYTHONPATH": str(Path(engine_process.__file__).parent)},
        capture_output=True, text=True, timeout=30, check=True,
    )  # fmt: skip
    assert done.stdout.strip() == "True"
    assert processes_with(str(tmp_path)) == []


def test_the_main_thread_never_waits_for_the_program() -> None:
    ticks: list[float] = []
    timer = QTimer()
    timer.setInterval(20)
    timer.timeout.connect(lambda: ticks.append(time.monotonic()))
    timer.start()
    run("time.sleep(1.0)\nfor i in range(20):\n print(i, flush=True); time.sleep(0.02)")
    timer.stop()
    gaps = [later - earlier for earlier, later in itertools.pairwise(ticks)]
    assert len(ticks) > 30
    assert max(gaps) < 0.25


def in_task(work: Callable[[], Any]) -> Any:
    """The result of ``work`` in the thread of a QgsTask, while the main thread runs its event loop."""
    found: list[Any] = []
    loop = QEventLoop()
    task = QgsTask.fromFunction("pump", lambda _: found.append((threading.current_thread(), work())))
    task.taskCompleted.connect(loop.quit)
    task.taskTerminated.connect(loop.quit)
    QgsApplication.taskManager().addTask(task)
    loop.exec()
    thread, result = found[0]
    assert thread is not threading.main_thread()
    return result


def in_python_thread(work: Callable[[], Any]) -> Any:
    found: list[Any] = []
    thread = threading.Thread(target=lambda: found.append(work()))
    thread.start()
    thread.join(30)
    return found[0]


@pytest.mark.parametrize("within", [in_task, in_python_thread])
def test_it_works_in_other_threads(within: Callable[[Callable[[], Any]], Any]) -> None:
    heard: list[tuple[bytes, Any]] = []

    def take(line: bytes) -> None:
        heard.append((line, threading.current_thread()))

    ended = within(lambda: run("for i in range(3):\n print(i, flush=True)\nsys.exit(7)", take))
    assert ended == Ended(7, "", cancelled=False)
    assert [line for line, _ in heard] == [b"0", b"1", b"2"]
    assert len({thread for _, thread in heard}) == 1


@pytest.mark.parametrize("within", [in_task, in_python_thread])
def test_it_is_cancelled_in_other_threads(within: Callable[[Callable[[], Any]], Any], tmp_path: Path) -> None:
    feedback, pressed = QgsFeedback(), []

    def take(line: bytes) -> None:
        pressed.append(time.monotonic())
        feedback.cancel()

    child = f"subprocess.Popen([sys.executable, '-c', 'import time; time.sleep(60)', {str(tmp_path)!r}])"
    body = f"os.setsid()\nsignal.signal(signal.SIGTERM, signal.SIG_IGN)\n{child}\n{ENDLESS}"
    assert within(lambda: run(body, take, feedback)).cancelled
    assert time.monotonic() - pressed[0] < 2.0
    wait_until(lambda: not processes_with(str(tmp_path)), 1.0)
