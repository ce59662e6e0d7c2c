"""The truth about ground that moved along itself: how far each place has moved, and how heights have changed."""

from __future__ import annotations

from typing import Any

import geopandas
import numpy as np
import shapely
from pyproj import CRS

from ...engine.core.arrays import Bool, Float
from ...engine.grid.grid import Grid
from ..frame import Frame
from ..motion.moved_ground import SurfaceMotion, true_motion, volumes, within
from .scene import Scene

BANDS = ("True motion east", "True motion north", "True motion up")
_ROWS_AT_ONCE = 64


def ground_motion(after: Scene, before: Scene, world: Float) -> Float:
    """(n, 3) true motion (east, north, up) of the ``before`` ground under (n, 2+) projected coordinates, m.

    0 where it rests; NaN where it is buried in the ``after`` ground. ``after`` and ``before`` are of one slope. What
    erosion has done to the material on its way is no motion.
    """
    frame = before.frame
    u, v = frame.rotate_to_local(world[:, 0] - frame.east, world[:, 1] - frame.north)
    way = np.zeros((len(u), 3))
    for motion in after.motions:
        inside = within(motion, u, v)
        if inside.any():
            way[inside] = true_motion(motion, after.base, u[inside], v[inside])
    return in_world(frame, way)


def in_world(frame: Frame, way: Float) -> Float:
    """(n, 3) vectors of the local frame as east, north and up."""
    return np.column_stack([way[:, :2] @ frame.axes, way[:, 2]])


def motion_raster(after: Scene, before: Scene, grid: Grid) -> dict[str, Float]:
    """``ground_motion`` at the middle of each cell (rows, columns), m, by the name of its band."""
    raster = np.zeros((3, *grid.shape))
    x = grid.west + (np.arange(grid.columns) + 0.5) * grid.cell
    y = grid.north - (np.arange(grid.rows) + 0.5) * grid.cell
    for start in range(0, grid.rows, _ROWS_AT_ONCE):
        rows = slice(start, start + _ROWS_AT_ONCE)
        places = np.column_stack([places.ravel() for places in np.meshgrid(x, y[rows])])
        raster[:, rows] = ground_motion(after, before, places).T.reshape(3, -1, grid.columns)
    return dict(zip(BANDS, raster, strict=True))


def change_raster(after: Scene, before: Scene, grid: Grid, subsamples: int) -> Float:
    """Mean change of height of each cell (rows, columns), m, from ``subsamples`` x ``subsamples`` places in it.

    Only where ground moved or changed, or everywhere where the two scenes' relief differs.
    """
    raster = np.zeros(grid.shape)
    offsets = (np.arange(subsamples) + 0.5) / subsamples * grid.cell
    frame = before.frame
    for row in range(grid.rows):
        x = (grid.west - frame.east + np.arange(grid.columns) * grid.cell)[:, None, None] + offsets[None, None, :]
        y = grid.north - frame.north - (row + 1) * grid.cell + offsets[None, :, None]
        u, v = frame.rotate_to_local(*np.broadcast_arrays(x, y))
        touched = np.ones(grid.columns, dtype=bool)
        if after.base is before.base:
            touched = _touched(after, u, v)
        if touched.any():
            u, v = u[touched], v[touched]
            raster[row, touched] = (after.height(u, v) - before.height(u, v)).mean(axis=(1, 2))
    return raster


def _touched(after: Scene, u: Float, v: Float) -> Bool:
    """Which cells (n, ...) have a place within the bounds of a motion or a change."""
    inside: Bool = np.zeros(u.shape, dtype=bool)
    moving, changing = [m.bounds for m in after.motions], [c.bounds for c in after.changes]
    for bounds in (*moving, *changing):
        west, south, east, north = bounds
        within = (u >= west) & (u <= east) & (v >= south) & (v <= north)
        inside[within] = True
    return np.asarray(inside.any(axis=(1, 2)))


def describe_motion(motion: SurfaceMotion, ground: Scene) -> dict[str, Any]:
    """Kind, place, vector of the middle and volumes of a motion, for truth.json and the layer of outlines."""
    plane, frame = motion.plane, ground.frame
    middle = np.array([plane.u]), np.array([plane.v])
    place = frame.to_world(np.array([[plane.u, plane.v, float(ground.base(*middle)[0])]]))[0]
    east, north, up = in_world(frame, true_motion(motion, ground.base, *middle))[0]
    raised, lowered = volumes(motion, ground.base)
    return {
        "kind": motion.kind,
        "x": round(float(place[0]), 4),
        "y": round(float(place[1]), 4),
        "amount_m": motion.amount,
        "east_m": float(east),
        "north_m": float(north),
        "up_m": float(up),
        "area_m2": float(outline(motion, frame).area),
        "volume_raised_m3": raised,
        "volume_lowered_m3": lowered,
    }


def outline(motion: SurfaceMotion, frame: Frame) -> shapely.Polygon:
    """The ellipse in which the face's plane moves, on the map, before the motion."""
    half_across, half_along = motion.half_axes
    turn = np.linspace(0.0, 2 * np.pi, 65)[:-1]
    plane = motion.plane
    ring = np.zeros((64, 3))
    ring[:, 0] = plane.u + half_across * np.cos(turn)
    ring[:, 1] = plane.v + half_along * plane.cosine * np.sin(turn)
    return shapely.Polygon(frame.to_world(ring)[:, :2])


def outlines(motions: tuple[SurfaceMotion, ...], ground: Scene, crs: CRS) -> geopandas.GeoDataFrame:
    """One polygon a motion, with its description."""
    rows = [describe_motion(motion, ground) for motion in motions]
    columns = {name: [row[name] for row in rows] for name in rows[0] if name not in ("x", "y")}
    return geopandas.GeoDataFrame(columns, geometry=[outline(m, ground.frame) for m in motions], crs=crs)
