"""How well two registered surfaces agree on stable ground."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from ..core.arrays import Float, Index
from ..core.errors import InputError
from ..geometry.height_correction import HeightCorrection
from ..geometry.pose import Pose
from ..geometry.voxels import block_numbers
from ..statistics.robust import nmad, robust_scale
from .bare_ground import MAX_BARE_PLANT_ERROR_M
from .point_to_plane import Matcher, Pairs
from .surface import nearest

_SOURCES = 60_000
STABLE_SCALES = 3.0  # scales within which a residual is noise
_MIN_PAIRS = 20
_MIN_BLOCKS, _MIN_BLOCK_PAIRS = 8, 20
_MAX_NOISE_RATIO = 3.0  # times the surfaces' own noise: what differs more is no noise, however much of the ground it is
MIN_STABLE_SHARE = 0.15  # share below which there is nothing to register by


@dataclass(frozen=True)
class Agreement:
    """Point-to-plane residuals, moving minus reference, on ground that did not change. Lengths are metres.

    Attributes:
        scale: noise of a residual after registration.
        stable_share: share of the overlap within three scales. Points over the reference whose counterpart is out of
            reach count to the overlap.
        overlap_share: share of the moving points that have a counterpart.
        nmad_before, nmad_after, rms_before, rms_after: of the stable points' residuals.
        misfit: spread over the surface of the stable ground's residual, noise taken out: what a rigid motion leaves.
            Only of ground that is bare, if vegetation is known: elsewhere vegetation makes such a spread, too.
        misfit_height: the same as a height.
        mean_normal: (3,) mean upward normal of the stable ground.
        places, normals: (k, 3) of a sample of the stable ground, local coordinates before registration.
        spread: of all height differences about zero, changed ground included.
        sample: (n, 3) places of the compared points after registration, local coordinates.
        agrees: (n,) which of them are stable ground.
    """

    scale: float
    stable_share: float
    overlap_share: float
    nmad_before: float
    nmad_after: float
    rms_before: float
    rms_after: float
    misfit: float
    misfit_height: float
    mean_normal: Float
    places: Float
    normals: Float
    spread: float
    sample: Float
    agrees: NDArray[np.bool_]


def agreement(
    matcher: Matcher,
    pose: Pose,
    offset: float,
    correction: HeightCorrection | None = None,
    among: NDArray[np.bool_] | None = None,
) -> Agreement:
    """Measure how well the surfaces agree at ``pose``; ``offset`` (m) is how far apart they may be.

    Args:
        correction: of the moving surface's heights at ``pose``, in local coordinates.
        among: (m,) the moving surface's points that may be stable ground; all without it.

    Raises:
        InputError: hardly any point has a counterpart.
    """
    reach = max(offset, 3 * matcher.spacing)
    sources = matcher.moving.sample(_SOURCES)
    judged = matcher.moving.sample(_SOURCES, matcher.firm)
    pairs = matcher.onto_reference(pose, judged, reach, 0.5)
    if len(pairs) < _MIN_PAIRS:
        raise InputError(
            f"Only {len(pairs)} points of the later epoch have a counterpart within {reach:g} m on the earlier one, "
            "so the epochs do not overlap or hold no surface; check the files, their ground and the largest offset."
        )
    distance = matcher.neighbours(pose, sources, reach)[0]
    if correction is not None:
        pairs = replace(pairs, residual=pairs.residual + pairs.normal[:, 2] * correction.at(pairs.place[:, :2]))
    # where hardly anything is stable the core of the residuals is change
    may = np.ones(len(pairs), dtype=bool) if among is None else among[pairs.source]
    scale = max(min(robust_scale(pairs.residual[may]), _MAX_NOISE_RATIO * matcher.noise), 1e-4)
    stable = may & (np.abs(pairs.residual) <= STABLE_SCALES * scale)
    before = matcher.onto_reference(Pose.identity(), pairs.source[stable], reach, 0.5).residual
    after = pairs.residual[stable]
    normals = pairs.normal[stable] * np.where(pairs.normal[stable][:, 2:] < 0, -1.0, 1.0)
    mean = normals.mean(axis=0) if len(normals) else np.array([0.0, 0.0, 1.0])
    misfit = _misfit(pairs, stable & _bare(matcher, pairs), 20 * matcher.spacing)
    steep = np.abs(normals[:, 2]) < 0.2
    cosine = np.median(np.abs(normals[~steep][:, 2])) if (~steep).any() else 0.2
    return Agreement(
        scale=scale,
        stable_share=float(stable.sum() / (len(stable) + _out_of_reach(matcher, pose, judged, reach))),
        overlap_share=float(np.isfinite(distance).mean()),
        nmad_before=_nmad(before),
        nmad_after=_nmad(after),
        rms_before=_rms(before),
        rms_after=_rms(after),
        misfit=misfit,
        misfit_height=misfit / float(cosine),
        mean_normal=mean / np.linalg.norm(mean),
        places=matcher.moving.points[pairs.source[stable]][:: max(1, len(after) // 5000)],
        normals=normals[:: max(1, len(after) // 5000)],
        spread=nmad(pairs.residual, 0.0) / float(cosine),
        sample=pairs.place,
        agrees=stable,
    )


def _out_of_reach(matcher: Matcher, pose: Pose, judged: Index, reach: float) -> int:
    """How many of the moving points lie over the reference, but farther from it than ``reach``."""
    far = judged[~np.isfinite(matcher.neighbours(pose, judged, reach)[0])]
    if not len(far):
        return 0
    plan = cKDTree(matcher.reference.points[:, :2])
    away = plan.query(pose.apply(matcher.moving.points[far])[:, :2], distance_upper_bound=3 * matcher.spacing)[0]
    return int(np.count_nonzero(np.isfinite(away)))


def widened(error: float, quality: Agreement, minimum_share: float) -> float:
    """The standard error of a height (m) where less than ``minimum_share`` of the ground is stable.

    The less there is of it, the less certain it is that it did not move: the error then approaches the spread of
    all height differences.
    """
    if quality.stable_share >= minimum_share:
        return error
    share = max(quality.stable_share, 0.02) / minimum_share
    return float(np.hypot(error / share, (1.0 - share) * quality.spread))


def _bare(matcher: Matcher, pairs: Pairs) -> NDArray[np.bool_]:
    """(n,) pairs on ground that is bare in both surveys, as far as it is known."""
    bare = np.ones(len(pairs), dtype=bool)
    if matcher.moving.plants is not None:
        bare &= matcher.moving.plants[pairs.source] <= MAX_BARE_PLANT_ERROR_M
    if matcher.reference.plants is not None:
        bare &= matcher.reference.plants[nearest(matcher.reference.tree, pairs.place)[1]] <= MAX_BARE_PLANT_ERROR_M
    return bare


def _misfit(pairs: Pairs, stable: NDArray[np.bool_], block: float) -> float:
    """Spread about zero of the blocks' mean residual, less what the noise of the means explains.

    Neighbours share errors, as those by vegetation. So the noise of a mean follows from the means of the block's parts,
    cubes of a third of its side: their variance over their number.
    """
    if not stable.any():
        return 0.0
    residual, place = pairs.residual[stable], pairs.place[stable]
    number, part = block_numbers(place, block), block_numbers(place, block / 3.0)
    _, first, own = np.unique(part, return_index=True, return_inverse=True)
    of, means = number[first], np.bincount(own, residual) / np.bincount(own)
    parts, pairs_of = np.bincount(of), np.bincount(number)
    enough = (pairs_of >= _MIN_BLOCK_PAIRS) & (parts > 1)
    if np.count_nonzero(enough) < _MIN_BLOCKS:
        return 0.0
    mean = np.bincount(of, means)[enough] / parts[enough]
    scatter = np.bincount(of, means**2)[enough] / parts[enough] - mean**2
    noise = float(np.mean(scatter / (parts[enough] - 1)))
    spread = nmad(mean, 0.0)
    return float(np.sqrt(max(spread**2 - noise, 0.0)))


def _nmad(values: Float) -> float:
    return nmad(values) if len(values) else 0.0


def _rms(values: Float) -> float:
    return float(np.sqrt(np.mean(values**2))) if len(values) else 0.0
