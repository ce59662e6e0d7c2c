"""M3C2 and py4dgeo's: counts against a search through all points, time, and the surface that a grid covers."""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np

from ...engine.change.difference import difference
from ...engine.core.arrays import Float
from ...engine.core.compiled import take_kernels
from ...engine.core.kept_memory import keep_freed_memory
from ...engine.grid.grid import cell_index
from ...engine.m3c2.distances import Cylinder, Distances, Status, m3c2_distances
from ...engine.m3c2.lattice import Lattice
from ...engine.m3c2.normals import fit_planes
from ...engine.m3c2.scales import choose_scales, overlap_bounds, spread_cores
from ...interface.parameters import ChangeParameters, DistanceParameters, SurveyParameters
from ...simulation.surveys.survey import simulate_pair
from .chain import inside
from .peers import PeerMissingError, run_on_arrays, version
from .real_data import DENSE_HALVES, dense_cloud, split
from .table import Row

CHECKED = 300  # core points whose cylinders are searched through all points
REPEATS = 5
_PEER = """
import json, sys, time
import numpy as np, py4dgeo
folder, diameter, radius, half_length, repeats = sys.argv[1], *map(float, sys.argv[2:6])
first, second, core, normal = (np.load(f"{folder}/{n}.npy") for n in ("first", "second", "core", "normal"))
origin, seconds, work = first.mean(axis=0), [], []
for _ in range(int(repeats)):
    start, worked = time.perf_counter(), time.process_time()
    epochs = py4dgeo.Epoch(first - origin), py4dgeo.Epoch(second - origin)
    common = dict(epochs=epochs, corepoints=core - origin, normal_radii=(diameter / 2,), cyl_radius=radius)
    py4dgeo.M3C2(max_distance=half_length, **common).run()
    seconds.append(time.perf_counter() - start)
    work.append(time.process_time() - worked)
distance, report = py4dgeo.M3C2(max_distance=half_length, corepoint_normals=normal, **common).run()
np.save(f"{folder}/peer.npy", np.column_stack([report["num_samples1"], report["num_samples2"], distance]))
print(json.dumps({"seconds": min(seconds), "work": min(work)}))
"""


def rows() -> list[Row]:
    """Ground of a simulated pair (39 degrees, 70 % vegetation), core points every 0.25 m and every 0.1 m."""
    pair = simulate_pair(SurveyParameters(seed=1, points=1_000_000, amplitude=0.3, offset=0.0), roi_buffer=0.0)
    first, second = (c.xyz[inside(c.xyz, pair) & c.truth_ground.astype(bool)] for c in (pair.first, pair.second))
    scales = choose_scales(first, second, DistanceParameters())
    radius, found = scales.projection_scale / 2, []
    core = first[spread_cores(first, scales.core_spacing, overlap_bounds(first, second))]
    for segments in (3, 4):  # py4dgeo cuts the cylinder into ceil(half length / radius)
        half_length = (segments - 0.5) * radius
        (seconds, _), own = _own(first, second, core, scales.normal_scale, radius, half_length)
        chosen = np.flatnonzero(own.status != Status.NO_NORMAL)[:: max(1, len(core) // CHECKED)]
        truth = np.array([_brute_force(first, second, own, k, radius, half_length) for k in chosen])
        counts = np.column_stack([own.reference.count, own.moving.count])
        share = float(np.mean((counts[chosen] == truth).all(axis=1)))
        try:
            (peer_seconds, _), peer = _peer(
                first, second, own.core, own.normal, scales.normal_scale, radius, half_length
            )
            peer_share = float(np.mean((peer[chosen, :2] == truth).all(axis=1)))
            others = f"py4dgeo {version('py4dgeo')}: {100 * peer_share:.1f} %"
            faster = f"py4dgeo {version('py4dgeo')} {peer_seconds:.2f} s, ratio {peer_seconds / seconds:.2f}"
        except PeerMissingError as error:
            others = faster = f"not measured: {error}"
        name = f"M3C2, {len(core)} core points, cylinder of {segments} segments"
        found += [
            Row(
                f"{name}: counts equal to a search through all points, {len(chosen)} cores",
                f"{100 * share:.1f} %",
                "100 %",
                others,
                share == 1.0,
            ),
            Row(f"{name}: normals and distances", f"{seconds:.2f} s", "", faster),
        ]
    found.append(_surface_row("ground under 70 % vegetation", first, second))
    cloud = dense_cloud()
    if cloud is not None:
        found.append(_surface_row(DENSE_HALVES, *split(cloud, 1)))
    return found


def _surface_row(scene: str, first: Float, second: Float) -> Row:
    """Surface a second at one resolution: a cell of the grid, and one core point in each of its common cells.

    By the clock, with as many cores as each uses (all there are), and by the work of all. The grid change runs as in a
    command that has registered: numba is loaded, freed memory is kept.
    """
    keep_freed_memory()
    take_kernels()
    parameters = ChangeParameters(adaptive=False)
    change = difference(first, second, parameters)
    times = [_times(lambda: difference(first, second, parameters)) for _ in range(4 * REPEATS)]
    seconds, work = (min(kind) for kind in zip(*times, strict=True))
    cell, point = np.unique(cell_index(first, change.grid), return_index=True)
    core = first[point[change.valid.ravel()[cell]]]
    surface = len(core) * change.grid.cell**2
    name = f"surface a second, {scene}: grid change of fixed cells of {change.grid.cell:g} m"
    target = "at least 20 times py4dgeo's M3C2"
    scales = choose_scales(first, second, DistanceParameters())
    radius, half_length = scales.projection_scale / 2, scales.half_length
    (own_seconds, own_work), own = _own(first, second, core, scales.normal_scale, radius, half_length)
    try:
        (peer_seconds, peer_work), _ = _peer(first, second, core, own.normal, scales.normal_scale, radius, half_length)
    except PeerMissingError as error:
        return Row(name, f"{surface / seconds:.0f} m²/s", target, f"not measured: {error}")
    others = (
        f"py4dgeo {version('py4dgeo')} {surface / peer_seconds:.0f} m²/s, one core point in each of the {len(core)} "
        f"common cells; by processor time {peer_work / work:.1f} x; M3C2 {own_seconds:.2f} s, processors "
        f"{own_work:.2f} s, py4dgeo {peer_seconds:.2f} s, {peer_work:.2f} s"
    )
    ratio = peer_seconds / seconds
    return Row(name, f"{surface / seconds:.0f} m²/s = {ratio:.1f} x", target, others, ratio >= 20)


def _own(
    first: Float, second: Float, core: Float, diameter: float, radius: float, half_length: float
) -> tuple[tuple[float, float], Distances]:
    """Best seconds for normals and distances from memory, by the clock and of all processors, and the result."""
    seconds, work, found = np.inf, np.inf, None
    for _ in range(REPEATS):
        start, worked = time.perf_counter(), time.process_time()
        normal = fit_planes(Lattice(first, diameter / 2), core, diameter).normal
        lattices = Lattice(first, radius), Lattice(second, radius)
        found = m3c2_distances(lattices, core, normal, Cylinder(radius, half_length))
        seconds = min(seconds, time.perf_counter() - start)
        work = min(work, time.process_time() - worked)
    assert found is not None
    return (seconds, work), found


def _peer(
    first: Float, second: Float, core: Float, normal: Float, diameter: float, radius: float, half_length: float
) -> tuple[tuple[float, float], Float]:
    """py4dgeo's best seconds by the clock and of all processors; its counts and distances with our normals, (m, 3)."""
    arrays = {"first": first, "second": second, "core": core, "normal": normal}
    printed, found = run_on_arrays("py4dgeo", _PEER, arrays, diameter, radius, half_length, REPEATS)
    return (float(printed["seconds"]), float(printed["work"])), found


def _brute_force(
    first: Float, second: Float, own: Distances, number: int, radius: float, half_length: float
) -> list[int]:
    counts = []
    for cloud in (first, second):
        offset = cloud - own.core[number]
        along = offset @ own.normal[number]
        across = np.linalg.norm(offset - along[:, None] * own.normal[number], axis=1)
        counts.append(int(np.sum((np.abs(along) <= half_length) & (across <= radius))))
    return counts


def _times(work: Callable[[], object]) -> tuple[float, float]:
    """Seconds by the clock and of all processors."""
    start, worked = time.perf_counter(), time.process_time()
    work()
    return time.perf_counter() - start, time.process_time() - worked
