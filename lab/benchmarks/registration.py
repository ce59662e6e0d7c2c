"""Registration where a known part of the surface has moved: stable ground against the known motion."""

from __future__ import annotations

import time

import numpy as np
from scipy.spatial.transform import Rotation

from ...engine.core.arrays import Float
from ...engine.geometry.rigid_transform import RigidTransform
from ...engine.registration.register import register
from ...interface.parameters import RegistrationParameters, SurveyParameters
from ...simulation.surveys.survey import simulate_pair
from .chain import inside
from .peers import PeerMissingError, run_on_arrays, version
from .real_data import DENSE_HALVES, dense_cloud, split
from .table import Row, say

OFFSET = 0.200
ROTATION = 2e-4  # rad: 6 mm at 30 m
LOWERED_SHARE, LOWERED_BY = 0.15, 0.30
ROI_BUFFER = 2.0
SEEDS = range(1, 6)


def rows() -> list[Row]:
    """Errors of the robust method, plain ICP and peers, on simulated slopes and a real cloud in two halves."""
    found = [_row("simulated slope, 39 degrees, ground under vegetation", [simulated(seed) for seed in SEEDS])]
    cloud = dense_cloud()
    if cloud is not None:
        cases = [changed_and_moved(*split(cloud, seed), seed) for seed in SEEDS]
        found += [_row(DENSE_HALVES, cases), *peer_rows(cases[0])]
    return found


Case = tuple[Float, Float, Float, RigidTransform]


def simulated(seed: int) -> Case:
    """Ground of two scans of one slope with its toe and crest, the later one partly lowered and moved.

    Without toe and crest the face is nearly a plane, along which nothing but its roughness stops a slide.
    """
    parameters = SurveyParameters(seed=seed, points=1_000_000, amplitude=0.0, offset=0.0)
    pair = simulate_pair(parameters, roi_buffer=ROI_BUFFER)
    first, second = (
        cloud.xyz[inside(cloud.xyz, pair) & cloud.truth_ground.astype(bool)] for cloud in (pair.first, pair.second)
    )
    return changed_and_moved(first, second, seed)


def changed_and_moved(first: Float, second: Float, seed: int) -> Case:
    """Lower a disc that holds LOWERED_SHARE of the points, then move all: reference, moving, stable, truth."""
    rng = np.random.default_rng([seed, 7])
    middle = first.mean(axis=0)
    disc = middle[:2] + rng.uniform(-3, 3, 2)
    distance = np.hypot(*(second[:, :2] - disc).T)
    lowered = distance <= np.quantile(distance, LOWERED_SHARE)
    changed = second - np.where(lowered[:, None], [0.0, 0.0, LOWERED_BY], 0.0)
    direction, axis = rng.normal(size=(2, 3))
    truth = RigidTransform(
        Rotation.from_rotvec(ROTATION * axis / np.linalg.norm(axis)).as_matrix(),
        OFFSET * direction / np.linalg.norm(direction),
        middle,
    )
    moved = truth.inverse().apply(changed)
    return first, moved, moved[~lowered], truth


PY4DGEO = """
import json, sys, time
import numpy as np, py4dgeo
folder = sys.argv[1]
reference, moving = (np.load(f"{folder}/{name}.npy") for name in ("reference", "moving"))
started, cpu = time.perf_counter(), time.process_time()
a, b = py4dgeo.Epoch(reference), py4dgeo.Epoch(moving)
for epoch in (a, b):
    epoch.build_kdtree()
    epoch.calculate_normals(radius=0.3)
found = py4dgeo.icp_with_stable_areas(
    a, b, initial_distance_threshold=0.5, level_of_detection=0.05, reference_supervoxel_resolution=1.0,
    supervoxel_resolution=1.0, min_svp_num=10, reduction_point=np.zeros(3))
taken = time.perf_counter() - started, time.process_time() - cpu
print(json.dumps({"matrix": found.affine_transformation.tolist(), "seconds": taken[0], "cpu": taken[1]}))
"""
OPEN3D = """
import json, sys, time
import numpy as np, open3d as o3d
folder = sys.argv[1]
clouds = (np.load(f"{folder}/{name}.npy") for name in ("reference", "moving"))
a, b = (o3d.geometry.PointCloud(o3d.utility.Vector3dVector(cloud)) for cloud in clouds)
started, cpu = time.perf_counter(), time.process_time()
a.estimate_normals(o3d.geometry.KDTreeSearchParamHybrid(radius=0.5, max_nn=30))
kernel = o3d.pipelines.registration.TukeyLoss(k=0.1)
found = o3d.pipelines.registration.registration_icp(
    b, a, 0.5, np.eye(4), o3d.pipelines.registration.TransformationEstimationPointToPlane(kernel),
    o3d.pipelines.registration.ICPConvergenceCriteria(1e-7, 1e-7, 200))
taken = time.perf_counter() - started, time.process_time() - cpu
print(json.dumps({"matrix": found.transformation.tolist(), "seconds": taken[0], "cpu": taken[1]}))
"""
SMALL_GICP = """
import json, sys, time
import numpy as np, small_gicp
folder = sys.argv[1]
reference, moving = (np.load(f"{folder}/{name}.npy") for name in ("reference", "moving"))
started, cpu = time.perf_counter(), time.process_time()
found = small_gicp.align(
    reference, moving, registration_type="GICP", downsampling_resolution=0.1, max_correspondence_distance=0.5,
    num_threads=int(__import__("os").environ.get("OMP_NUM_THREADS", 2)), max_iterations=100)
taken = time.perf_counter() - started, time.process_time() - cpu
print(json.dumps({"matrix": found.T_target_source.tolist(), "seconds": taken[0], "cpu": taken[1]}))
"""
PEERS = {
    "py4dgeo": ("its ICP with stable areas", PY4DGEO),
    "open3d": ("its point-to-plane ICP with Tukey's loss of 0.1 m", OPEN3D),
    "small_gicp": ("its generalised ICP on points thinned to 0.1 m", SMALL_GICP),
}
PEER_SHARE = 0.25  # of py4dgeo's time


def peer_rows(case: Case) -> list[Row]:
    """One real case by SlopeWatch and by each peer, one after the other, so that both find the machine alike."""
    reference, moving, stable, truth = case
    middle = reference.mean(axis=0)  # peers lose digits at large coordinates
    found: list[Row] = []
    arrays = {"reference": reference - middle, "moving": moving - middle}
    for peer, (what, script) in PEERS.items():
        started, cpu = time.perf_counter(), time.process_time()
        own = register(reference, moving, RegistrationParameters())
        seconds, cpu = time.perf_counter() - started, time.process_time() - cpu
        error = rms_mm(own.transform.apply(stable) - truth.apply(stable))
        name = f"the same cloud, first seed, and {peer} {version(peer)}: {what}"
        value = f"{error:.2f} mm, {seconds:.1f} s ({cpu:.1f} s CPU)"
        try:
            theirs, _ = run_on_arrays(peer, script, arrays)
        except (PeerMissingError, RuntimeError) as missing:
            found.append(Row(name, value, "", f"not measured: {str(missing).splitlines()[-1]}"))
            continue
        matrix = np.array(theirs["matrix"])
        their_error = rms_mm((stable - middle) @ matrix[:3, :3].T + matrix[:3, 3] + middle - truth.apply(stable))
        share = cpu / theirs["cpu"]
        goal = peer == "py4dgeo"
        found.append(
            Row(
                name,
                f"{value}: {share:.3f} of its CPU time, {seconds / theirs['seconds']:.3f} of its time",
                f"at most 1 mm, {PEER_SHARE:g} of its time" if goal else "",
                f"{their_error:.2f} mm, {theirs['seconds']:.1f} s ({theirs['cpu']:.1f} s CPU)",
                bool(error <= 1.0 and max(share, seconds / theirs["seconds"]) <= PEER_SHARE) if goal else None,
            )
        )
    return found


def rms_mm(offset: Float) -> float:
    """Root mean square length of offsets (n, 3) in metres, millimetres."""
    return 1000 * float(np.sqrt(np.mean(np.sum(offset**2, axis=1))))


def _row(name: str, cases: list[Case]) -> Row:
    errors: dict[str, list[float]] = {"robust": [], "icp": []}
    seconds: dict[str, list[float]] = {"robust": [], "icp": []}
    stated = []
    for reference, moving, stable, truth in cases:
        for method in errors:
            start = time.process_time()
            result = register(reference, moving, RegistrationParameters(method=method))
            seconds[method].append(time.process_time() - start)
            if method == "robust" and result.covariance is not None:
                stated.append(1000 * float(np.sqrt(np.trace(result.covariance[3:, 3:]))))
            errors[method].append(rms_mm(result.transform.apply(stable) - truth.apply(stable)))
        say(f"{name}: {errors['robust'][-1]:.2f} mm, icp {errors['icp'][-1]:.1f} mm")
    own, icp = np.array(errors["robust"]), np.array(errors["icp"])
    return Row(
        f"{name}: rms on stable ground, {len(cases)} seeds",
        f"{own.mean():.2f} mm (worst {own.max():.2f}), {np.mean(seconds['robust']):.1f} s CPU",
        "at most 2 mm",
        f"published ICP {icp.mean():.0f} mm, {np.mean(seconds['icp']):.1f} s CPU; "
        f"standard error the registration states {np.mean(stated):.2f} mm",
        bool(own.mean() <= 2.0),
    )
