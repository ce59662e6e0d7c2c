"""Other programs to measure against, each in an environment of its own below ``build/`` (made once, then kept)."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ...engine.core.arrays import Float

#: What a peer needs, pinned, so that the figures name what they were measured against.
PINNED = {
    "py4dgeo": ("py4dgeo==1.2.0",),
    "open3d": ("open3d==0.19.0",),
    "fastgc": ("fastgc==0.2.0",),
    "small_gicp": ("small_gicp==1.0.1", "numpy==2.2.6"),
    "xdem": ("xdem==0.2.3", "scikit-gstat==1.0.26"),
    "torch_points3d": ("torch-points3d==1.3.0",),
}
_FAILED: dict[str, str] = {}
"""Why peers could not be installed, so that a run tries each once."""
FOLDER = Path(__file__).resolve().parents[2] / "build" / "peers"


class PeerMissingError(RuntimeError):
    """A peer cannot be installed here; the message is the reason in one line."""


def version(peer: str) -> str:
    """The pinned version of a peer."""
    return PINNED[peer][0].partition("==")[2]


def peer_python(peer: str) -> Path:
    """The interpreter of an environment that holds the peer; made at the first call.

    Raises:
        PeerMissingError: it cannot be installed.
    """
    folder = FOLDER / peer
    python = folder / ("Scripts/python.exe" if os.name == "nt" else "bin/python")
    ready = folder / "ready.txt"
    wanted = "\n".join([sys.version, *PINNED[peer]])
    if ready.is_file() and ready.read_text(encoding="utf-8") == wanted:
        return python
    if peer in _FAILED:
        raise PeerMissingError(_FAILED[peer])
    shutil.rmtree(folder, ignore_errors=True)
    _call(peer, [sys.executable, "-m", "venv", str(folder)])
    _call(peer, [str(python), "-m", "pip", "install", "--quiet", "--only-binary=:all:", *PINNED[peer]])
    _call(peer, [str(python), "-c", f"import {peer}"])
    ready.write_text(wanted, encoding="utf-8")
    return python


def run_peer(peer: str, script: str, *arguments: str, threads: int | None = None) -> dict[str, Any]:
    """Run the lines ``script`` (they see ``sys.argv[1:]`` as ``arguments``) with the peer's interpreter.

    It runs in an empty folder of its own, removed after: py4dgeo writes a log into the current one. Paths among the
    ``arguments`` must be absolute.

    Args:
        threads: how many threads it may use; its own choice by default.

    Returns:
        The JSON object in the last line that it prints. Arrays are best passed as ``.npy`` files.

    Raises:
        PeerMissingError: it cannot be installed.
        RuntimeError: it failed.
    """
    environment = {k: v for k, v in os.environ.items() if k not in ("PYTHONPATH", "VIRTUAL_ENV", "OMP_NUM_THREADS")}
    if threads is not None:
        environment["OMP_NUM_THREADS"] = str(threads)
    command = [str(peer_python(peer)), "-c", script, *arguments]
    with tempfile.TemporaryDirectory() as scratch:
        done = subprocess.run(command, env=environment, cwd=scratch, capture_output=True, text=True, check=False)
    if done.returncode:
        raise RuntimeError(f"{peer} failed: {done.stderr[-2000:]}")
    found: dict[str, Any] = json.loads(done.stdout.strip().splitlines()[-1])
    return found


def run_on_arrays(peer: str, script: str, arrays: Mapping[str, Float], *numbers: float) -> tuple[dict[str, Any], Float]:
    """``run_peer`` on the files NAME.npy of ``arrays`` in a folder, whose path and ``numbers`` are its arguments.

    Returns:
        What the script prints, and the array that it writes to peer.npy in the folder; an empty one without.

    Raises:
        PeerMissingError: it cannot be installed.
        RuntimeError: it failed.
    """
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for stem, array in arrays.items():
            np.save(folder / f"{stem}.npy", array)
        printed = run_peer(peer, script, name, *map(str, numbers))
        written = folder / "peer.npy"
        return printed, np.load(written) if written.exists() else np.empty(0)


def _call(peer: str, command: list[str]) -> None:
    with tempfile.TemporaryDirectory() as scratch:
        done = subprocess.run(command, cwd=scratch, capture_output=True, text=True, check=False)
    if done.returncode:
        lines = [line for line in (done.stderr or done.stdout).strip().splitlines() if line.startswith("ERROR")]
        reason = lines[-1].removeprefix("ERROR: ") if lines else f"{command[-1]} failed"
        _FAILED[peer] = f"{PINNED[peer][0]} cannot be installed: {reason}"
        raise PeerMissingError(_FAILED[peer])
