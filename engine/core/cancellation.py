"""Cancelling: child processes and temporary files that must not outlive the command.

The command runs in the main thread. A watcher thread is woken by a signal (through ``signal.set_wakeup_fd``, which
works while native code runs) or by the parent's death (standard input closes), ends the children, removes what is
half-written and exits at once. Native work that holds the interpreter's lock belongs into a child (``run_child``).
"""

from __future__ import annotations

import contextlib
import os
import shutil
import signal
import socket
import subprocess
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

from .errors import Cancelled

_lock = threading.RLock()
_children: set[subprocess.Popen[bytes]] = set()
_temporaries: list[tuple[Path, bool, Sequence[str]]] = []
_cancelled = threading.Event()
_wakeup: tuple[socket.socket, socket.socket] | None = None
_CLEANING_S = 0.5  # seconds that what is half-written is removed again and again


@contextlib.contextmanager
def temporary(path: Path, *, only_empty: bool = False, unless: Sequence[str] = ()) -> Iterator[Path]:
    """``path`` (a file or folder) is removed when the block is left, and when the command is cancelled.

    With ``only_empty`` a folder stays if something is in it; else if it holds one of the files ``unless``.
    """
    entry = (path, only_empty, unless)
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


def install(on_cancel: Callable[[], None], *, watch_parent: bool) -> None:
    """Make signals, and with ``watch_parent`` the end of standard input, cancel the command.

    With ``watch_parent`` the process also leads a group of its own, which its parent can end as a whole.
    ``on_cancel`` informs the user; then the process exits with 130 at once.
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
        if hasattr(os, "setsid"):
            with contextlib.suppress(OSError):  # it leads one already
                os.setsid()
        threading.Thread(target=wait_for_parent, daemon=True, name="parent").start()


def abort(on_cancel: Callable[[], None]) -> None:
    """End the children, remove the temporaries, exit with 130. Does not return."""
    _cancelled.set()
    with _lock:
        children, paths = list(_children), list(_temporaries)
        for child in children:
            _end(child)
        # Other threads may still be creating files in a folder while it is removed, or be removing it themselves.
        until = time.monotonic() + _CLEANING_S
        while True:
            for entry in reversed(paths):
                _remove(*entry)
            if time.monotonic() > until or not any(os.path.lexists(path) for path, *_ in paths):
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


def _remove(path: Path, only_empty: bool, unless: Sequence[str]) -> None:
    with contextlib.suppress(OSError):
        if path.is_symlink() or not path.is_dir():
            path.unlink(missing_ok=True)
        elif only_empty:
            path.rmdir()
        elif not any((path / name).exists() for name in unless):
            shutil.rmtree(path, ignore_errors=True)
