"""What an extraction of ground gives back."""

from __future__ import annotations

from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

from .cover import GroundCover, percent

CLASS_2, AS_IS = "class 2 of the survey", "all points, as they are"
"""What ``GroundResult.filter`` says of ground that was given."""
MIN_VEGETATION_HEIGHT_M = 0.3
"""Least height (m) above the ground of what counts as vegetation."""
_OF_STRIPS = ("disagreement_before_m", "disagreement_after_m")
HEIGHT_OVER_GROUND = "height_over_ground"
"""Name of the dimension in the classified cloud, metres."""


@dataclass(frozen=True)
class TilesUsed:
    """Tiles of an extraction that did not fit into memory in one piece, and how they agree where they meet.

    ``count`` tiles of ``side_m``, which begin at ``west_m`` and ``south_m`` in the slope's frame (the dominant plane
    laid flat about its centroid, axes as the map's), with ``halo_m`` around each. The heights over the triangles of
    two tiles were compared at ``seam_points`` points within ``seam_width_m`` beyond their edges:
    ``seam_share_beyond`` of them differ by more than ``seam_limit_m``; median and 99 % of the difference, metres.
    """

    count: int
    side_m: float
    halo_m: float
    west_m: float
    south_m: float
    memory_limit_gb: float
    seam_width_m: float
    seam_points: int
    seam_limit_m: float
    seam_share_beyond: float
    seam_median_m: float
    seam_p99_m: float


@dataclass(frozen=True)
class GroundResult:
    """What was extracted, and what the published tables report.

    Lengths in metres, areas in m², densities in points per m², angles in degrees. ``ground`` is the output;
    ``clipped`` the denoised cloud within the region; ``classified`` the same with class 2 for ground, 1 for the rest;
    ``pipelines`` the PDAL pipelines that make them. ``vegetation_cover`` is C_v, see ``metrics.vegetation_cover``; None
    where the ground was given. ``raw_area`` and ``roi_area`` without a region are those of occupied cells of 1 m².
    ``plane_*`` describe the dominant plane; ``scatter`` and ``threshold`` come from the refinement (0 and the parameter
    without it). ``cover`` describes what covers the ground and how well it is known below, None where that was not
    asked. ``tiles`` is None for a cloud that was extracted in one piece, ``strips`` (``StripFit.facts``) where strips
    were not compared. ``shared_points`` are ground because of another survey, see ``shared_ground``.
    """

    ground: Path
    clipped: Path
    classified: Path
    pipelines: tuple[Path, ...]
    raw_points: int
    raw_area: float
    raw_density: float
    roi_points: int
    roi_area: float
    roi_density: float
    ground_points: int
    ground_ratio: float
    vegetation_cover: float | None
    outliers: int
    spacing: float
    plane_normal: tuple[float, float, float]
    plane_dip: float
    plane_azimuth: float
    plane_share: float
    scatter: float
    threshold: float
    filter: str
    warnings: tuple[str, ...]
    seconds: dict[str, float]
    cover: GroundCover | None = None
    tiles: TilesUsed | None = None
    strips: dict[str, Any] | None = None
    shared_points: int = 0

    def sentence(self) -> str:
        """What a log says of it: which points are ground, and what covers them; empty where neither is to be told."""
        if self.filter == CLASS_2:
            return f"Ground: the points of class 2, {percent(self.ground_ratio)} of all points."
        if self.filter == AS_IS:
            return "Ground: all points, as they are."
        if self.cover is None or self.vegetation_cover is None:
            return ""
        return (
            f"Ground is {percent(self.ground_ratio)} of the points. Vegetation higher than {MIN_VEGETATION_HEIGHT_M:g} "
            f"m covers {percent(self.vegetation_cover)} of the slope. {percent(self.cover.without_ground_share)} of "
            "the slope has no ground return."
        )

    def figures(self) -> dict[str, Any]:
        """The numbers by name."""
        own = {f.name: getattr(self, f.name) for f in fields(self) if isinstance(getattr(self, f.name), (int, float))}
        fit = {} if self.strips is None else {f"strips_{name}": self.strips[name] for name in _OF_STRIPS}
        return own | fit | (self.cover.figures() if self.cover else {})
