"""The picture of M3C2 distances on the face itself, seen square to the plane that fits it best."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from ..core.progress import Progress
from ..statistics.normal import Z95
from ..zones.face_zones import FaceZones
from .heatmap import write_heatmap_png
from .heatmap_image import Words, make_heatmap
from .relief import shaded_relief
from .top_view import TopView

_WORDS = Words(
    title="Distance along the normal (M3C2)",
    legend="Distance along the normal (m)",
    veil=("grey veil: measured, but", "not significant over the face"),
    upwards="up",
)


def write_face_png(
    path: Path, found: FaceZones, limit: float, epochs: tuple[str, str], progress: Progress | None = None
) -> None:
    """Write significant distances in colour over the relief of the face, with the zones, in metres of its plane.

    Args:
        limit: end of the colours, metres.

    Raises:
        InputError: the folder is missing or not writable.
    """
    # it needs matplotlib, which takes half a second to import
    from .picture_words import say

    face = found.face
    relief = np.zeros((*face.grid.shape, 4), dtype=np.uint8)
    relief[..., :3] = np.clip(np.rint(shaded_relief(face.depth, face.grid.cell)), 0, 255)
    relief[..., 3] = np.where(np.isfinite(face.depth), 255, 0)
    view = TopView(relief, face.grid, "height")
    drawn = make_heatmap(face.distance, found.significant, Z95 * face.error, face.grid, view, limit=limit)
    plane = face.face
    place = say("plane of {0}°, seen from azimuth {1}°").format(f"{plane.dip:.0f}", f"{plane.seen_from:.0f}")
    heatmap = replace(drawn, words=_WORDS)
    write_heatmap_png(path, heatmap, zones=found.outlines, epochs=epochs, name=place, progress=progress)
