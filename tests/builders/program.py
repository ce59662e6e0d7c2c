"""The command line as a process of its own: ``run`` for what a command does, ``start`` for one that is interrupted.

A fresh interpreter takes two seconds of processor time to load numpy, GDAL and the others. ``run`` therefore forks a
server process that has loaded them; each command still has its own process, environment, streams, and exit code.
Loading itself is tested in tests/cli/test_commands.py, with ``COMMAND``.
"""

from __future__ import annotations

import multiprocessing
import os
import subprocess
import sys
import tempfile
from pathlib import Path

COMMAND = [sys.executable, "-m", "slopewatch.cli"]
LONGEST_RUN_S = 600  # only a command that hangs takes as long, however busy the machine is
LOADED = [
    "slopewatch.cli.program",
    *(f"slopewatch.workflows.{name}" for name in ("change", "ground", "inspect", "m3c2", "register", "series")),
    *("slopewatch.workflows.report", "slopewatch.workflows.simulate", "slopewatch.workflows.screen"),
    *("slopewatch.engine.report.charts", "slopewatch.engine.report.maps", "matplotlib.backends.backend_agg"),
]


def run(
    *arguments: object, env: dict[str, str] | None = None, limits: dict[str, int] | None = None
) -> subprocess.CompletedProcess[str]:
    """Run ``slopewatch ARGUMENTS`` to its end, in this environment or in ``env``.

    Args:
        limits: of the process where the system knows them: ``AS`` bytes beyond what is loaded, ``CPU`` seconds,
            ``FSIZE`` bytes of a file.
    """
    words = [str(argument) for argument in arguments]
    environment = dict(os.environ if env is None else env)
    if "forkserver" not in multiprocessing.get_all_start_methods():
        return subprocess.run(
            [*COMMAND, *words], capture_output=True, text=True, encoding="utf-8", stdin=subprocess.DEVNULL,
            timeout=LONGEST_RUN_S, env=environment, check=False,
        )  # fmt: skip
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(LOADED)
    with tempfile.TemporaryDirectory() as folder:
        streams = [Path(folder) / name for name in ("out", "err")]
        process = context.Process(target=_command, args=(words, environment, os.getcwd(), *map(str, streams), limits))
        process.start()
        process.join(LONGEST_RUN_S)
        if process.is_alive():
            process.kill()
            raise subprocess.TimeoutExpired(words, LONGEST_RUN_S)
        out, err = (path.read_text(encoding="utf-8") for path in streams)
    assert process.exitcode is not None
    return subprocess.CompletedProcess(words, process.exitcode, out, err)


def _command(
    words: list[str], environment: dict[str, str], folder: str, out: str, err: str, limits: dict[str, int] | None
) -> None:
    """What the forked process does: the streams, environment and folder of a program that was just started."""
    os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
    for number, path in ((1, out), (2, err)):
        os.dup2(os.open(path, os.O_WRONLY | os.O_CREAT), number)
    sys.stdin, sys.stdout, sys.stderr = (
        os.fdopen(number, mode, encoding="utf-8", closefd=False) for number, mode in ((0, "r"), (1, "w"), (2, "w"))
    )
    os.chdir(folder)
    os.environ.clear()
    os.environ.update(environment)
    _limit(limits or {})
    sys.argv = ["slopewatch", *words]
    from slopewatch.cli import main

    main()


def _limit(limits: dict[str, int]) -> None:
    if not limits or not sys.platform.startswith("linux"):
        return
    import resource

    with open("/proc/self/statm", encoding="ascii") as file:
        loaded = int(file.read().split()[0]) * resource.getpagesize()
    for name, value in limits.items():
        most = value + loaded if name == "AS" else value
        resource.setrlimit(getattr(resource, f"RLIMIT_{name}"), (most, most))
