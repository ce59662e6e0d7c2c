"""One command in a process of its own with limits of time and memory, and what must hold whatever it was given."""

from __future__ import annotations

import csv
import json
import os
import re
import resource
import signal
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

MEMORY_LIMIT_B = 5 << 30
"""Of addresses that a command may use beyond those of the loaded program."""
MOST_MEMORY_MB = 1500.0
"""Of what it really takes. The sound files of the targets take at most 500."""
LONGEST_S = 60
"""Of processor time; the sound files of the targets take at most 5."""
LONGEST_WAIT_S = 600
"""Of time by the clock: on a machine that does much else a sound file may take a minute."""
_WRONG = re.compile(rb"Traceback|Internal failure|RuntimeWarning|Segmentation|panicked", re.IGNORECASE)
_NO_NUMBER = re.compile(r"[+-]?(nan|inf|infinity)", re.IGNORECASE)


@dataclass(frozen=True)
class Done:
    """``code``: exit status, negative for a signal; ``peak_mb`` of resident memory."""

    code: int
    out: bytes
    error: bytes
    seconds: float
    peak_mb: float


def run_apart(words: list[str], environment: dict[str, str] | None = None) -> Done:
    """Fork this process, which has loaded the engine, and run ``slopewatch WORDS`` there to its end."""
    with tempfile.TemporaryFile() as out, tempfile.TemporaryFile() as error:
        started = time.monotonic()
        child = os.fork()
        if child == 0:
            _child(words, environment or {}, out.fileno(), error.fileno())
        _, status, usage = os.wait4(child, 0)
        seconds = time.monotonic() - started
        texts = []
        for stream in (out, error):
            stream.seek(0)
            texts.append(stream.read())
    return Done(os.waitstatus_to_exitcode(status), *texts, seconds, usage.ru_maxrss / 1024)


def _child(words: list[str], environment: dict[str, str], out: int, error: int) -> None:
    """Never returns."""
    try:
        os.setpgid(0, 0)
        os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
        os.dup2(out, 1)
        os.dup2(error, 2)
        sys.stdout, sys.stderr = (os.fdopen(n, "w", encoding="utf-8", closefd=False) for n in (1, 2))
        with open("/proc/self/statm", encoding="ascii") as file:
            used = int(file.read().split()[0]) * resource.getpagesize()
        resource.setrlimit(resource.RLIMIT_AS, (used + MEMORY_LIMIT_B,) * 2)
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        # ends the process, whatever it waits for
        signal.signal(signal.SIGALRM, signal.SIG_DFL)
        signal.alarm(LONGEST_WAIT_S)
        resource.setrlimit(resource.RLIMIT_CPU, (LONGEST_S, LONGEST_S))
        os.environ.update(environment)
        sys.argv = ["slopewatch", *words]
        from slopewatch.cli import main

        main()
    except SystemExit as end:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(end.code if isinstance(end.code, int) else 1)
    except BaseException as failure:
        print(f"Traceback: {type(failure).__name__}: {failure}", file=sys.stderr, flush=True)
        os._exit(1)
    os._exit(0)


def fault(done: Done, out: Path, named: tuple[str, ...]) -> str:
    """What is wrong about how a command ended; nothing where all is as promised.

    Args:
        named: words of which a refusal must hold one, such as the file's name.
        out: folder for its outputs, empty before.
    """
    if done.code in (-signal.SIGALRM, -signal.SIGXCPU, -signal.SIGKILL):
        return f"no end within {LONGEST_S} s of processor time or {LONGEST_WAIT_S} s of waiting"
    if done.peak_mb > MOST_MEMORY_MB:
        return f"{done.peak_mb:.0f} MB of memory"
    if done.code not in (0, 2):
        return f"exit code {done.code}: {_last(done.error)}"
    if _WRONG.search(done.error) or _WRONG.search(done.out):
        return f"exit code {done.code} with: {_WRONG.search(done.error + done.out)!r}"
    hidden = [p.name for p in out.rglob(".*")]
    if hidden:
        return f"left behind: {hidden}"
    return _refusal_fault(done, out, named) if done.code == 2 else _result_fault(out)


def _last(text: bytes) -> str:
    lines = text.decode("utf-8", "replace").strip().splitlines()
    return lines[-1][:500] if lines else "nothing said"


def _refusal_fault(done: Done, out: Path, named: tuple[str, ...]) -> str:
    lines = done.error.decode("utf-8", "replace").strip().splitlines()
    sentences = [line for line in lines if line.startswith("Error: ")]
    if len(sentences) != 1 or lines[-1] != sentences[0]:
        return f"not one sentence: {lines}"
    sentence = sentences[0]
    if not sentence.endswith((".", "?)")):
        return f"no full stop: {sentence[:500]}"
    if len(sentence) > 1500:
        return f"{len(sentence)} characters: {sentence[:300]}"
    if not sentence.isprintable():
        return f"characters that do not print: {sentence!r}"
    if not any(word in sentence for word in named):
        return f"names no file: {sentence[:500]}"
    left = [str(p.relative_to(out)) for p in out.rglob("*")]
    return f"refused and wrote {left}" if left else ""


def _result_fault(out: Path) -> str:
    """A number among the outputs that is none: NaN or infinity in JSON, or as a cell of a table."""
    for path in sorted(out.rglob("*")):
        if path.suffix == ".json":
            found: list[str] = []
            json.loads(path.read_text(encoding="utf-8"), parse_constant=found.append)
        elif path.suffix == ".csv":
            with path.open(encoding="utf-8", newline="") as stream:
                rows = list(csv.reader(stream))[1:]  # a column may have any name
            found = [cell for row in rows for cell in row if _NO_NUMBER.fullmatch(cell.strip())]
        else:
            continue
        if found:
            return f"{path.name} has {found[0]!r}"
    return ""
