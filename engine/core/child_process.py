"""Child processes with a memory limit that end with their parent, and their peak memory."""

from __future__ import annotations

import contextlib
import os
import shutil
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from .cancellation import _cancelled, _children, _end, _lock
from .errors import Cancelled, EngineError
from .temporary_folders import unnamed_file

_LAUNCHER = Path(__file__).with_name("child_launcher.py")


class ChildTimeout(EngineError):
    """A program took longer than it may."""


@dataclass(frozen=True)
class ChildResult:
    """How a child ended; ``returncode`` is negative for a signal."""

    returncode: int
    stdout: bytes
    stderr: bytes
    seconds: float


def run_child(
    arguments: Sequence[str | os.PathLike[str]],
    *,
    stdin: bytes = b"",
    memory_limit: int | None = None,
    time_limit_s: float | None = None,
    environment: Mapping[str, str] | None = None,
    directory: Path | None = None,
    each_line: Callable[[bytes], None] | None = None,
) -> ChildResult:
    """Run a program to its end; cancelling the command ends it.

    Args:
        arguments: program and its arguments, no shell.
        stdin: what it reads.
        memory_limit: bytes of address space it may take (POSIX only).
        time_limit_s: seconds after which it is ended; not together with ``each_line``.
        environment: its whole environment; the own one by default.
        directory: where it runs; the own one by default.
        each_line: called with each line of its standard output, as soon as that is there.

    Raises:
        Cancelled: the command is being cancelled.
        ChildTimeout: it did not end within its time.
        EngineError: the program cannot be started.
        InputError: the temporary folder is full.
    """
    started = time.monotonic()

    command = _launched([os.fspath(argument) for argument in arguments], memory_limit, environment)
    # a file: what communicate() has not written to a pipe when its time is up, it never writes
    with unnamed_file(stdin) if stdin else open(os.devnull, "rb") as given, _lock:
        if _cancelled.is_set():
            raise Cancelled("cancelled")
        try:
            child = subprocess.Popen(
                command,
                stdin=given,
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
    try:
        out, err = child.communicate(timeout=time_limit_s) if each_line is None else _followed(child, each_line)
    except subprocess.TimeoutExpired as error:
        _end(child)
        child.wait()
        raise ChildTimeout(f"{os.fspath(arguments[0])} did not end within {time_limit_s:.0f} s") from error
    finally:
        with _lock:
            _children.discard(child)
        if child.poll() is None:
            _end(child)
    if _cancelled.is_set():
        raise Cancelled("cancelled")
    return ChildResult(child.returncode, out, err, time.monotonic() - started)


def _followed(child: subprocess.Popen[bytes], each_line: Callable[[bytes], None]) -> tuple[bytes, bytes]:
    """What a child writes until it ends; a thread empties standard error, which would else fill up and stop it."""
    assert child.stdout is not None
    assert child.stderr is not None
    complaints: list[bytes] = []
    reader = threading.Thread(target=lambda stream: complaints.append(stream.read()), args=(child.stderr,), daemon=True)
    reader.start()
    lines = []
    with child.stdout, child.stderr:
        try:
            for line in child.stdout:
                lines.append(line)
                each_line(line)
        except BaseException:
            _end(child)  # else closing its standard error waits for the thread that reads it
            raise
        finally:
            reader.join()
    child.wait()
    return b"".join(lines), b"".join(complaints)


def _launched(arguments: list[str], memory_limit: int | None, environment: Mapping[str, str] | None) -> list[str]:
    """The command line that starts ``arguments`` with a limit and so that it dies with this process.

    Never by ``preexec_fn``: in a process with threads the child can hang before its program starts.
    """
    if os.name != "posix":
        return arguments
    path = (os.environ if environment is None else environment).get("PATH", os.defpath)
    if shutil.which(arguments[0], path=path) is None:
        raise EngineError(f"{arguments[0]} cannot be started (no such program)")
    launcher = [sys.executable, "-I", "-S", str(_LAUNCHER), str(os.getpid()), str(memory_limit or 0)]
    return launcher + arguments


def peak_memory() -> int:
    """Peak resident bytes of this process; 0 where the system does not report it (only Linux does)."""
    try:
        for line in Path("/proc/self/status").read_text().splitlines():
            if line.startswith("VmHWM:"):
                return int(line.split()[1]) * 1024
    except (OSError, ValueError, IndexError):
        pass
    return 0


def reset_peak_memory() -> None:
    """Start ``peak_memory`` anew for this process, where the system can."""
    with contextlib.suppress(OSError):
        Path("/proc/self/clear_refs").write_text("5")
