"""Errors of a registration that only blocks of stable patches show: few independent places, and a strain."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..core.arrays import Float
from ..geometry.voxels import block_numbers
from .block_jackknife import block_jackknife
from .measured import Measured, covering
from .part_information import CORRELATED, LEFT_OUT_BLOCK_WIDTHS
from .patch_agreement import FINAL_POINTS, REACH_SPACINGS, levels
from .point_to_plane import Matcher
from .stable_patches import agreement_weights
from .strain import estimated_strain
from .surface_patches import Patches, equations


def with_block_errors(found: Measured, matcher: Matcher, patches: Patches) -> Measured:
    """``found`` with errors widened where few places fix a direction, and with those of a strain.

    Args:
        patches: of the moving surface; those count that agree with the solution.
    """
    solution = found.solution
    information = solution.information
    if solution.left or information is None:
        return found
    pose = solution.pose
    system = equations(matcher, patches, pose, REACH_SPACINGS * matcher.spacing, FINAL_POINTS)
    level, compared = levels(system, matcher.noise, 1.0)
    fit = agreement_weights(patches, compared, system.excess(np.zeros((1, 6))), level)[:, 0]
    some = np.flatnonzero(fit > 0)
    if not len(some):
        return found
    block = block_numbers(patches.centre[some], LEFT_OUT_BLOCK_WIDTHS * patches.width)
    if block.max() <= 6:  # no more blocks than unknowns
        return found
    noise = np.maximum(system.rest[some], float(np.median(system.rest[some])) / 4)
    weight = fit[some] * system.pairs[some] / (CORRELATED * np.maximum(noise, 1e-12))
    matrices, vectors = weight[:, None, None] * system.matrix[some], weight[:, None] * system.vector[some]
    fixed = information.directions[:, information.observable]
    few = _few_places(matrices, vectors, block, fixed, information.covariance)
    found = covering(found, few)
    strain = estimated_strain(matrices, vectors, pose.apply(patches.centre[some]), block)
    places = found.quality.places
    if strain is None or not len(places):
        return found
    stretched = np.zeros((6, 6))
    stretched[3:, 3:] = strain.displacement(pose.apply(places))
    return replace(covering(found, stretched), strain=strain)


def _few_places(matrices: Float, vectors: Float, block: Float, fixed: Float, covariance: Float) -> Float:
    """(6, 6) by which few blocks widen the ``covariance`` (6, 6) in the directions ``fixed`` (6, q)."""
    if not fixed.shape[1]:
        return np.zeros((6, 6))
    own = np.einsum("ia,kij,jb->kab", fixed, matrices, fixed), vectors @ fixed
    solution = -np.linalg.solve(own[0].sum(axis=0), own[1].sum(axis=0))
    widen = block_jackknife(*own, solution, block)[1]
    whole = fixed @ widen @ fixed.T + np.eye(6) - fixed @ fixed.T
    return np.asarray(whole @ covariance @ whole - covariance)
