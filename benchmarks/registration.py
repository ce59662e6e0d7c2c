"""Registration where a known part of the surface has moved: stable ground against the known motion."""

from __future__ import annotations

import sys
import time
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from ..engine.clouds import read_cloud
from ..engine.parameters import InputParameters, RegistrationParameters, SurveyParameters
from ..engine.registration import register
from ..engine.transform import RigidTransform
from ..simulation.survey import simulate_pair
from .controlled_test import inside
from .table import Row

Float = NDArray[np.float64]
OFFSET = 0.200
ROTATION = 2e-4  # rad: 6 mm at 30 m
LOWERED_SHARE, LOWERED_BY = 0.15, 0.30
ROI_BUFFER = 2.0
SEEDS = range(1, 6)
REAL = Path(__file__).resolve().parents[2] / "shared" / "data" / "real" / "lone-star.copc.laz"
REAL_CRS = "EPSG:32614"  # the file declares a geocentric system but holds projected coordinates


def rows() -> list[Row]:
    """Errors of the robust method beside plain ICP's, on simulated slopes and on a real cloud split in halves."""
    found = [_row("simulated slope, 39 degrees, ground under vegetation", [_simulated(seed) for seed in SEEDS])]
    if REAL.exists():
        cloud = read_cloud(REAL, InputParameters(crs=REAL_CRS)).xyz
        found.append(_row("real cloud (392 points/m²) split in two halves", [_split(cloud, s) for s in SEEDS]))
    return found


Case = tuple[Float, Float, Float, RigidTransform]


def _simulated(seed: int) -> Case:
    """Ground of two scans of one slope with its toe and crest, the later one partly lowered and moved.

    Without toe and crest the face is nearly a plane, along which nothing but its roughness stops a slide.
    """
    parameters = SurveyParameters(seed=seed, points=1_000_000, amplitude=0.0, offset=0.0)
    pair = simulate_pair(parameters, roi_buffer=ROI_BUFFER)
    clouds = []
    for cloud in (pair.first, pair.second):
        clouds.append(cloud.xyz[inside(cloud.xyz, pair) & cloud.truth_ground.astype(bool)])
    return _changed_and_moved(*clouds, seed)


def _split(cloud: Float, seed: int) -> Case:
    half = np.random.default_rng(seed).permutation(len(cloud)) < len(cloud) // 2
    return _changed_and_moved(cloud[half], cloud[~half], seed)


def _changed_and_moved(first: Float, second: Float, seed: int) -> Case:
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
            found = result.transform
            difference = found.apply(stable) - truth.apply(stable)
            errors[method].append(1000 * float(np.sqrt(np.mean(np.sum(difference**2, axis=1)))))
        print(f"  {name}: {errors['robust'][-1]:.2f} mm, icp {errors['icp'][-1]:.1f} mm", file=sys.stderr, flush=True)
    own, icp = np.array(errors["robust"]), np.array(errors["icp"])
    return Row(
        f"{name}: rms on stable ground, {len(cases)} seeds",
        f"{own.mean():.2f} mm (worst {own.max():.2f}), {np.mean(seconds['robust']):.1f} s CPU",
        "at most 2 mm",
        f"published ICP {icp.mean():.0f} mm, {np.mean(seconds['icp']):.1f} s CPU; "
        f"standard error the registration states {np.mean(stated):.2f} mm",
        bool(own.mean() <= 2.0),
    )
