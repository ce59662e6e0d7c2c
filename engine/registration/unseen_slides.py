"""How far slides that nobody sees pull a registration along, and what windows of a surface have in common."""

from __future__ import annotations

import numpy as np

from ..core.arrays import Float
from .moving_windows import WINDOW_RADII_WIDTHS, Windows

DEVIATIONS = 5.5  # standard deviations of a window's motion from which a slide is seen for certain


def unseen(windows: Windows, weight: Float, fixed: Float) -> Float:
    """(6, 6) covariance of ``solved`` if one of the widest windows slid by as much as is not seen.

    The pull of such a slide grows with the window's share of the surface, its standard error falls with the root
    of it: widest windows pull most of all that nobody sees. By how much it slid is uniform up to what is seen.
    """
    scale = windows.scale(WINDOW_RADII_WIDTHS[-1], weight)
    if not scale.enough.any():
        return np.zeros((6, 6))
    spread = scale.inverse[scale.enough] * scale.by_chance(windows.solved(weight, fixed))
    matrix = (weight[:, None, None] * (fixed.T @ windows.matrix)).reshape(len(weight), -1)
    inside = (windows.near(WINDOW_RADII_WIDTHS[-1]) @ matrix).reshape(len(weight), -1, 6)[scale.enough]
    shift = scale.along[scale.enough][:, :, 3:].transpose(0, 2, 1)
    whole = matrix.sum(axis=0).reshape(-1, 6) @ fixed
    whole += 1e-6 * np.trace(whole) * np.eye(len(whole))
    pull = np.linalg.solve(whole, inside[:, :, 3:] @ shift)
    found = (pull @ spread @ pull.transpose(0, 2, 1)).mean(axis=0)
    return np.asarray(DEVIATIONS**2 / 3 * fixed @ found @ fixed.T)


def alike(windows: Windows, weight: Float, fixed: Float) -> Float:
    """(6, 6) covariance of ``solved`` by what neighbours have in common, more than by patches that err alone.

    One of the widest windows after the other is left out (a jackknife; Efron and Stein 1981), against one patch
    after the other. Each patch lies in as many windows as there are patches in one, by which the sum is divided.
    """
    left = (weight[:, None] * (windows.vector + windows.matrix @ windows.solved(weight, fixed))) @ fixed
    matrices = weight[:, None, None] * (fixed.T @ windows.matrix @ fixed)
    size = matrices.shape[1]
    whole = matrices.sum(axis=0)
    found = []
    for near in (windows.near(WINDOW_RADII_WIDTHS[-1]), windows.near(0.0)):
        without = whole - (near @ matrices.reshape(-1, size**2)).reshape(-1, size, size)
        without += 1e-3 * np.diag(np.diag(whole))
        steps = np.linalg.solve(without, (near @ left)[:, :, None])[:, :, 0]
        found.append(steps.T @ steps / float(near.sum(axis=1).mean()))
    more = max(float(np.trace(found[0]) / max(np.trace(found[1]), 1e-300)) - 1.0, 0.0)
    return np.asarray(more * fixed @ found[1] @ fixed.T)
