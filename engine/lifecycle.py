"""Cancelling: child processes and temporary files that must not outlive the command.

The command runs in the main thread. A watcher thread hears of a signal (through ``signal.set_wakeup_fd``, which works
while native code runs) or of the parent's death (standard input closes), ends the children, removes what is
half-written and exits at once. Native work that holds the interpreter's lock belongs into a child (``run_child``).
"""

from __future__ import annotations

import contextlib
import os
import shutil
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from .errors import Cancelled, EngineError

_lock = threading.RLock()
_children: set[subprocess.Popen[bytes]] = set()
_temporaries: list[tuple[Path, bool]] = []
_cancelled = threading.Event()
_wakeup: tuple[socket.socket, socket.socket] | None = None
_STUBBORN = 0.5  # seconds that what is half-written is removed again and again
_LAUNCHER = Path(__file__).with_name("child_launcher.py")


@dataclass(frozen=True)
class ChildResult:
    """How a child ended. ``returncode`` is negative for a signal; ``peak_bytes`` its resident peak (0: unknown)."""

    returncode: int
    stdout: bytes
    stderr: bytes
    seconds: float
    peak_bytes: int


@contextlib.contextmanager
def temporary(path: Path, *, only_empty: bool = False) -> Iterator[Path]:
    """``path`` (a file or folder) is removed when the block is left, and when the command is cancelled.

    With ``only_empty`` a folder stays if something is in it.
    """
    entry = (path, only_empty)
    with _lock:
        _temporaries.append(entry)
    try:
        yield path
    finally:
        _remove(*entry)
        with _lock:
            _temporaries.remove(entry)


@contextlib.contextmanager
def uninterrupted() -> Iterator[None]:
    """Cancelling waits until the block is left; for a few renames that belong together."""
    with _lock:
        if _cancelled.is_set():
            raise Cancelled("cancelled")
        yield


def run_child(
    arguments: Sequence[str | os.PathLike[str]],
    *,
    stdin: bytes = b"",
    memory_limit: int | None = None,
    environment: Mapping[str, str] | None = None,
    directory: Path | None = None,
    on_poll: Callable[[], None] | None = None,
) -> ChildResult:
    """Run a program to its end; cancelling the command ends it.

    Args:
        arguments: program and its arguments, no shell.
        stdin: what it reads.
        memory_limit: bytes of address space it may take (POSIX only).
        environment: its whole environment; the own one by default.
        directory: where it runs; the own one by default.
        on_poll: called about five times a second while it runs.

    Raises:
        Cancelled: the command is being cancelled.
        EngineError: the program cannot be started.
    """
    started = time.monotonic()

    command = _launched([os.fspath(argument) for argument in arguments], memory_limit, environment)
    with _lock:
        if _cancelled.is_set():
            raise Cancelled("cancelled")
        try:
            child = subprocess.Popen(
                command,
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.PIPE,
                env=None if environment is None else dict(environment),
                cwd=directory,
                start_new_session=os.name == "posix",
                creationflags=getattr(subprocess, "CREATE_NO_WINDOW", 0),
            )
        except OSError as error:
            raise EngineError(f"{os.fspath(arguments[0])} cannot be started ({error.strerror})") from error
        _children.add(child)
    peak = 0
    pending: bytes | None = stdin
    try:
        while True:
            try:
                out, err = child.communicate(pending, timeout=0.05 if time.monotonic() - started < 0.5 else 0.2)
                break
            except subprocess.TimeoutExpired:
                pending = None
                peak = max(peak, peak_memory(child.pid))
                if on_poll is not None:
                    on_poll()
    finally:
        with _lock:
            _children.discard(child)
        if child.poll() is None:
            _end(child)
    if _cancelled.is_set():
        raise Cancelled("cancelled")
    return ChildResult(child.returncode, out, err, time.monotonic() - started, peak)


def _launched(arguments: list[str], memory_limit: int | None, environment: Mapping[str, str] | None) -> list[str]:
    """The command line that starts ``arguments`` with a limit and so that it dies with this process.

    Never by ``preexec_fn``: in a process with threads the child can hang for ever before its program starts.
    """
    if os.name != "posix":
        return arguments
    path = (os.environ if environment is None else environment).get("PATH", os.defpath)
    if shutil.which(arguments[0], path=path) is None:
        raise EngineError(f"{arguments[0]} cannot be started (no such program)")
    launcher = [sys.executable, "-I", "-S", str(_LAUNCHER), str(os.getpid()), str(memory_limit or 0)]
    return launcher + arguments


def peak_memory(pid: int | str = "self") -> int:
    """Peak resident bytes of a process; 0 where the system does not tell (only Linux does)."""
    try:
        for line in Path(f"/proc/{pid}/status").read_text().splitlines():
            if line.startswith("VmHWM:"):
                return int(line.split()[1]) * 1024
    except (OSError, ValueError, IndexError):
        pass
    return 0


def reset_peak_memory() -> None:
    """Start ``peak_memory`` anew for this process, where the system can."""
    with contextlib.suppress(OSError):
        Path("/proc/self/clear_refs").write_text("5")


def install(on_cancel: Callable[[], None], *, watch_parent: bool) -> None:
    """Make signals, and with ``watch_parent`` the end of standard input, cancel the command.

    ``on_cancel`` tells the user; then the process exits with 130 at once.
    """
    global _wakeup
    _wakeup = socket.socketpair()
    for end in _wakeup:
        end.setblocking(False)
    signal.set_wakeup_fd(_wakeup[1].fileno(), warn_on_full_buffer=False)
    for name in ("SIGINT", "SIGTERM", "SIGHUP", "SIGBREAK"):
        if hasattr(signal, name):
            signal.signal(getattr(signal, name), lambda *_: None)
    reader = _wakeup[0]
    reader.setblocking(True)

    def wait_for_signal() -> None:
        reader.recv(1)
        abort(on_cancel)

    def wait_for_parent() -> None:
        with contextlib.suppress(OSError, ValueError):
            while os.read(0, 4096):
                pass
        abort(on_cancel)

    threading.Thread(target=wait_for_signal, daemon=True, name="signals").start()
    if watch_parent:
        threading.Thread(target=wait_for_parent, daemon=True, name="parent").start()


def abort(on_cancel: Callable[[], None]) -> None:
    """End the children, remove the temporaries, exit with 130. Does not return."""
    _cancelled.set()
    with _lock:
        children, paths = list(_children), list(_temporaries)
        for child in children:
            _end(child)
        # Other threads may still be creating files in a folder while it is removed, or be removing it themselves.
        until = time.monotonic() + _STUBBORN
        while True:
            for path, only_empty in reversed(paths):
                _remove(path, only_empty)
            if time.monotonic() > until or not any(os.path.lexists(path) for path, _ in paths):
                break
            time.sleep(0.01)
        with contextlib.suppress(Exception):
            on_cancel()
        os._exit(Cancelled.exit_code)


def _end(child: subprocess.Popen[bytes]) -> None:
    with contextlib.suppress(OSError):
        if os.name == "posix":
            os.killpg(child.pid, signal.SIGKILL)
        else:
            child.kill()


def _remove(path: Path, only_empty: bool) -> None:
    with contextlib.suppress(OSError):
        if path.is_symlink() or not path.is_dir():
            path.unlink(missing_ok=True)
        elif only_empty:
            path.rmdir()
        else:
            shutil.rmtree(path, ignore_errors=True)
