"""Hazards on the nodes of a simulated surface: their forms, made irregular by the surface's own textures."""

from __future__ import annotations

import math

import numpy as np

from ...engine.core.arrays import Float32
from ...engine.geometry.hazard_shapes import SHAPES, Hazard
from .surface import Surface


def displacement(hazard: Hazard, surface: Surface, stride: int = 1) -> tuple[slice, slice, Float32]:
    """The displacement (m) at every ``stride``-th node within the hazard's bounds, and these nodes' slices."""
    rows, columns = surface.window(*hazard.bounds, stride)
    u, w = surface.nodes(rows, columns)
    du, dw = u - np.float32(hazard.u), w - np.float32(hazard.w)
    c, s = np.float32(math.cos(hazard.turn)), np.float32(math.sin(hazard.turn))
    x = (du * c + dw * s) * np.float32(1 / hazard.half_u)
    y = (dw * c - du * s) * np.float32(1 / hazard.half_w)
    folds = surface.texture(surface.folds, rows, columns, hazard.shift)
    if hazard.wobble:
        grow = np.float32(1.0) + np.float32(hazard.wobble) * np.clip(folds, -1.5, 2.0)
        x, y = x * grow, y * grow
    dz = SHAPES[hazard.kind](hazard, x, y, surface.texture(surface.bumps, rows, columns, hazard.shift))
    dz *= np.clip(1.0 + 1.5 * hazard.wobble * folds, 0.5, 1.5)
    return rows, columns, dz.astype(np.float32, copy=False)
