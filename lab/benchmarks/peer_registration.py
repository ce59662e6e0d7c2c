"""Registration against Open3D, small_gicp and py4dgeo: a known motion, a part of the surface lowered."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ...engine.core.version import VERSION
from .peer_case import Case, Judged, own_tool, script_tool
from .peers import version
from .real_data import DENSE_HALVES, dense_cloud, split
from .registration import OPEN3D, PY4DGEO, SMALL_GICP, changed_and_moved, rms_mm, simulated
from .registration import Case as Moved

OWN = """
import json, sys, time
import numpy as np
from slopewatch.engine.registration.register import register
from slopewatch.interface.parameters import RegistrationParameters
folder = sys.argv[1]
reference, moving = (np.load(f"{folder}/{name}.npy") for name in ("reference", "moving"))
started, cpu = time.perf_counter(), time.process_time()
found = register(reference, moving, RegistrationParameters())
taken = time.perf_counter() - started, time.process_time() - cpu
print(json.dumps({"matrix": found.transform.matrix.tolist(), "seconds": taken[0], "cpu": taken[1]}))
"""
TOOLS = (
    own_tool("SlopeWatch register", VERSION, OWN),
    script_tool("Open3D, point-to-plane ICP, Tukey's loss", "open3d", version("open3d"), OPEN3D),
    script_tool("small_gicp, generalised ICP", "small_gicp", version("small_gicp"), SMALL_GICP),
    script_tool("py4dgeo, ICP with stable areas", "py4dgeo", version("py4dgeo"), PY4DGEO),
)
QUICK_POINTS = 60_000


def cases(quick: bool) -> list[Case]:
    """A simulated slope with its toe and crest, and the dense real cloud in two halves."""
    found = [
        Case("registration", "simulated ground", lambda folder: _prepare(folder, simulated(1), quick), _judge, TOOLS)
    ]
    cloud = dense_cloud()
    if cloud is not None:
        halves = changed_and_moved(*split(cloud, 1), 1)
        found.append(Case("registration", DENSE_HALVES, lambda folder: _prepare(folder, halves, quick), _judge, TOOLS))
    return found


def _prepare(folder: Path, moved: Moved, quick: bool) -> tuple[Any, ...]:
    """Write both clouds about their middle, where peers lose no digits; the truth."""
    reference, moving, stable, truth = moved
    if quick:
        every = max(1, len(reference) // QUICK_POINTS)
        reference, moving = reference[::every], moving[::every]
    middle = reference.mean(axis=0)
    np.save(folder / "reference.npy", reference - middle)
    np.save(folder / "moving.npy", moving - middle)
    return stable, truth, middle


def _judge(truth: tuple[Any, ...], found: Path, printed: Mapping[str, Any]) -> Judged:
    """Root mean square displacement of the points that were not lowered."""
    stable, transform, middle = truth
    matrix = np.array(printed["matrix"])
    error = rms_mm((stable - middle) @ matrix[:3, :3].T + matrix[:3, 3] + middle - transform.apply(stable))
    return Judged(error, f"{error:.2f} mm rms on stable ground")
