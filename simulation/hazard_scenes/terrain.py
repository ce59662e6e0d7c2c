"""The undamaged slope: a planar or benched cross-section, curvature and roughness, over its own mean plane."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...engine.core.arrays import Float
from .negatives import Negative
from .styles import SceneSpec, Style, log_uniform, style_of
from .surface import Surface, add_coarse, new_surface, roughen, smooth_line

EDGE_REACH = 0.35
"""Points this close (m) to a bench's edge or inner corner count as bench edge."""


@dataclass(frozen=True)
class Bench:
    """A berm: w of its inner corner, of its outer edge below it, m along the mean plane; ``outer`` < ``inner``."""

    outer: float
    inner: float


@dataclass(frozen=True)
class Terrain:
    """An undamaged slope.

    ``dip`` is the angle of the mean plane (rad); ``benches`` its berms from below; ``faces`` the (from, to) of w of
    the faces between them; ``shift`` (nodes of u) is how far the berms wander up the slope, m; ``fine_rms`` the
    roughness (m) of wavelengths below 1 m.
    """

    surface: Surface
    dip: float
    benches: tuple[Bench, ...]
    faces: tuple[tuple[float, float], ...]
    shift: NDArray[np.float32]
    fine_rms: float


@dataclass(frozen=True)
class _Section:
    """A cross-section in its mean plane's frame: vertices (w, n), w rising from 0 to ``length``; ``dip`` in rad."""

    w: Float
    n: Float
    dip: float
    benches: tuple[Bench, ...]

    @property
    def length(self) -> float:
        return float(self.w[-1])


def build_terrain(spec: SceneSpec, rng: np.random.Generator) -> Terrain:
    """The slope of a scene before structures, landforms and hazards."""
    style = style_of(spec.kind)
    aspect = log_uniform((0.8, 2.5), rng)
    section = _draw_section(style, math.sqrt(spec.area / aspect), rng)
    extent = (spec.area / section.length, section.length)
    # About 1.6 nodes a point: no detail is lost between points, and none is computed that no point shows.
    step = min(max(0.8 / math.sqrt(spec.density), 0.045), 0.1)
    surface = new_surface(extent, step, rng)
    shift = _add_section(surface, section, rng)
    _add_curvature(surface, style.curvature, rng)
    fine = roughen(surface, log_uniform(style.roughness, rng), rng.uniform(*style.exponent), rng)
    if style.curvature > 0.5:  # natural rather than cut ground rolls at all scales
        add_coarse(surface, 0.15, 0.5, 2.2, 6.0, 25.0, rng)
    edges = [0.0, *(place for bench in section.benches for place in (bench.outer, bench.inner)), section.length]
    faces = tuple(zip(edges[::2], edges[1::2]))
    return Terrain(surface, section.dip, section.benches, faces, shift, fine)


def _draw_section(style: Style, length: float, rng: np.random.Generator) -> _Section:
    """A cross-section of about ``length`` m along the mean plane."""
    face_height, ratio = rng.uniform(6.0, 10.0), rng.uniform(0.5, 1.5)
    berm = rng.uniform(1.5, 3.0)
    face = face_height * math.hypot(1.0, ratio)
    benches = min(4, round((length - face) / (face + 0.7 * berm)))
    if rng.random() >= style.benched or benches < 1:
        dip = math.radians(rng.uniform(*style.dip))
        return _Section(np.array([0.0, length]), np.zeros(2), dip, ())
    # Vertices in the world's vertical plane: y towards the slope, z up; berms fall 3 % towards the face.
    y, z = [0.0], [0.0]
    for number in range(benches + 1):
        height = face_height * rng.uniform(0.9, 1.1)
        y.append(y[-1] + height * ratio)
        z.append(z[-1] + height)
        if number < benches:
            y.append(y[-1] + berm)
            z.append(z[-1] - 0.03 * berm)
    dip = math.atan2(z[-1], y[-1])
    cosine, sine = math.cos(dip), math.sin(dip)
    w = np.array(y) * cosine + np.array(z) * sine
    n = np.array(z) * cosine - np.array(y) * sine
    n -= np.interp(np.linspace(0, w[-1], 500), w, n).mean()
    found = tuple(Bench(float(w[i]), float(w[i + 1])) for i in range(1, 2 * benches, 2))
    return _Section(w, n, dip, found)


def _add_section(surface: Surface, section: _Section, rng: np.random.Generator) -> NDArray[np.float32]:
    """Add the cross-section with worn edges; berms wander along u. Returns how far, m, for each node of u."""
    nodes_u = surface.shape[0]
    shift = smooth_line(nodes_u, surface.step, 12.0, rng) * np.float32(rng.uniform(0.05, 0.25))
    if not section.benches:
        return np.zeros(nodes_u, dtype=np.float32)
    # Edges are worn over 0.2 to 0.6 m: a running mean of a fine table.
    spacing, worn = 0.02, rng.uniform(0.2, 0.6)
    table_w = np.arange(-4.0, section.length + 4.0, spacing)
    below = (section.n[1] - section.n[0]) / (section.w[1] - section.w[0])
    above = (section.n[-1] - section.n[-2]) / (section.w[-1] - section.w[-2])
    table = np.interp(table_w, section.w, section.n)
    table += np.where(table_w < 0, below * table_w, 0.0)
    table += np.where(table_w > section.length, above * (table_w - section.length), 0.0)
    window = np.hanning(max(3, round(worn / spacing)) + 2)
    padded = np.pad(table, len(window) // 2, mode="reflect", reflect_type="odd")
    table = np.convolve(padded, window / window.sum(), mode="same")[len(window) // 2 :][: len(table_w)]
    table32 = table.astype(np.float32)
    place = (surface.w[None, :] - shift[:, None] - np.float32(table_w[0])) * np.float32(1 / spacing)
    index = place.astype(np.int32)
    place -= index
    height = table32[index]
    height += place * (table32[index + 1] - height)
    surface.height += height
    for bench in section.benches:
        for edge in (bench.outer, bench.inner):
            reach = EDGE_REACH + 2 * surface.step
            _, columns = surface.window(0.0, edge + shift.min() - reach, 0.0, edge + shift.max() + reach)
            near = np.abs(surface.w[None, columns] - (edge + shift)[:, None]) < EDGE_REACH
            surface.mark(slice(None), columns, near, Negative.BENCH_EDGE)
    return shift


def _add_curvature(surface: Surface, largest: float, rng: np.random.Generator) -> None:
    """Bend the slope by up to ``largest`` m along u, along w and by twisting."""
    along, across, twist = rng.dirichlet((1.0, 1.0, 1.0)) * rng.uniform(-largest, largest, 3)
    u = np.linspace(-1, 1, surface.shape[0], dtype=np.float32)[:, None]
    w = np.linspace(-1, 1, surface.shape[1], dtype=np.float32)[None, :]
    surface.height += np.float32(along) * (u * u - 1 / 3) + np.float32(across) * (w * w - 1 / 3)
    surface.height += np.float32(twist) * (u * w)
