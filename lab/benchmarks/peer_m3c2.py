"""M3C2 against py4dgeo's: clouds moved by a known vector, whose component along the normal is the true distance."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ...engine.core.arrays import Float
from ...engine.core.version import VERSION
from ...engine.m3c2.scales import choose_scales, overlap_bounds, spread_cores
from ...interface.parameters import DistanceParameters, SurveyParameters
from ...simulation.surveys.survey import simulate_pair
from .chain import inside
from .peer_case import Case, Judged, own_tool, script_tool
from .peers import version
from .real_data import DENSE_HALVES, dense_cloud, split

MOVED_M = np.array([0.05, -0.03, 0.12])
"""What the second cloud is moved by."""
QUICK_CORES = 1_000
HEAD = """
import json, sys, time
import numpy as np
folder = sys.argv[1]
first, second, core, scales = (np.load(f"{folder}/{name}.npy") for name in ("first", "second", "core", "scales"))
diameter, radius, half_length = scales
"""
TAIL = """
np.save(f"{folder}/found/distance.npy", distance)
np.save(f"{folder}/found/normal.npy", normal)
np.save(f"{folder}/found/level.npy", level)
print(json.dumps({"seconds": taken[0], "cpu": taken[1]}))
"""
KERNELS = """
from slopewatch.engine.core.compiled import take_kernels
take_kernels()
some = np.random.default_rng(0).uniform(0, 1, (100, 3))
fit_planes(Lattice(some, 0.5), some, 0.5)
cylinder_statistics(Lattice(some, 0.5), some, some, Cylinder(0.5, 0.5))
"""
"""Loads the compiled loops as from 60,000 core points on, or in a process that has registered before: a start."""
IMPORTS = """
from slopewatch.engine.m3c2.distances import Cylinder, cylinder_statistics, m3c2_distances
from slopewatch.engine.m3c2.lattice import Lattice
from slopewatch.engine.m3c2.normals import fit_planes
"""
WORK = """
started, cpu = time.perf_counter(), time.process_time()
normal = fit_planes(Lattice(first, diameter / 2), core, diameter).normal
found = m3c2_distances((Lattice(first, radius), Lattice(second, radius)), core, normal, Cylinder(radius, half_length))
taken = time.perf_counter() - started, time.process_time() - cpu
distance, normal, level = found.distance, found.normal, found.level
"""
OWN, BY_NUMPY = HEAD + IMPORTS + KERNELS + WORK + TAIL, HEAD + IMPORTS + WORK + TAIL
PY4DGEO = (
    HEAD
    + """
import py4dgeo
started, cpu = time.perf_counter(), time.process_time()
epochs = py4dgeo.Epoch(first), py4dgeo.Epoch(second)
m3c2 = py4dgeo.M3C2(
    epochs=epochs, corepoints=core, normal_radii=(diameter / 2,), cyl_radius=radius, max_distance=half_length)
distance, uncertainty = m3c2.run()
taken = time.perf_counter() - started, time.process_time() - cpu
normal, level = m3c2.directions(), uncertainty["lodetection"]
"""
    + TAIL
)
TOOLS = (
    own_tool("SlopeWatch m3c2", VERSION, OWN),
    own_tool("SlopeWatch m3c2, by numpy", VERSION, BY_NUMPY, peer=True),
    script_tool("py4dgeo, M3C2", "py4dgeo", version("py4dgeo"), PY4DGEO),
)


def cases(quick: bool) -> list[Case]:
    """Ground under 70 % vegetation, core points as the distances are spread by default, and the dense real cloud."""
    found = [Case("M3C2", "simulated ground", lambda folder: _prepare(folder, *_simulated(), quick), _judge, TOOLS)]
    cloud = dense_cloud()
    if cloud is not None:
        found.append(
            Case("M3C2", DENSE_HALVES, lambda folder: _prepare(folder, *split(cloud, 1), quick), _judge, TOOLS)
        )
    return found


def _simulated() -> tuple[Float, Float]:
    pair = simulate_pair(SurveyParameters(seed=1, points=1_000_000, amplitude=0.0, offset=0.0))
    first, second = (c.xyz[inside(c.xyz, pair) & c.truth_ground.astype(bool)] for c in (pair.first, pair.second))
    return first, second


def _prepare(folder: Path, first: Float, second: Float, quick: bool) -> Float:
    """Write clouds, cores and scales about the middle of the first; the true motion."""
    scales = choose_scales(first, second, DistanceParameters())
    core = first[spread_cores(first, scales.core_spacing, overlap_bounds(first, second))]
    if quick:
        core = core[:: max(1, len(core) // QUICK_CORES)]
    middle = first.mean(axis=0)
    second = second + MOVED_M
    for name, points in (("first", first), ("second", second), ("core", core)):
        np.save(folder / f"{name}.npy", np.ascontiguousarray(points - middle))
    lengths = [scales.normal_scale, scales.projection_scale / 2, scales.half_length]
    np.save(folder / "scales.npy", np.array(lengths))
    return MOVED_M


def _judge(truth: Float, found: Path, printed: Mapping[str, Any]) -> Judged:
    """Errors of the distances along each tool's own normals, and how many lie beyond the level it states."""
    distance, level = (np.load(found / f"{name}.npy").ravel() for name in ("distance", "level"))
    normal = np.load(found / "normal.npy").reshape(len(distance), 3)
    error = distance - normal @ truth
    known = np.isfinite(error) & np.isfinite(level)
    rms, beyond = np.sqrt(np.mean(error[known] ** 2)), np.mean(np.abs(error[known]) > level[known])
    middle = np.median(np.abs(error[known]))
    text = (
        f"{1000 * rms:.1f} mm rms, {1000 * middle:.1f} mm median at {known.sum():,} of {len(known):,} core points; "
        f"{100 * beyond:.1f} % beyond the stated 95 % level"
    )
    return Judged(1000 * float(rms), text)
