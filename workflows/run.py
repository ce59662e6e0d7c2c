"""The single steps as commands: files in, files out, a run record beside them."""

from __future__ import annotations

from pathlib import Path

from ..engine.core.progress import Progress
from ..engine.ground.classified_ground import warn_of_classes
from ..engine.ground.raw_survey import taken_as_ground
from ..engine.pointcloud.cloud import PointCloud


def ground_of(cloud: PointCloud, ground: str, progress: Progress) -> PointCloud:
    """The points of a cloud that ``SurfaceParameters.ground`` takes, without colours; warns where they are no surface.

    Raises:
        InputError: there is none, or those of class 2 contradict each other.
    """
    mask = taken_as_ground(cloud.classification, ground, cloud.path)
    taken = cloud if mask is None else PointCloud(cloud.xyz[mask], cloud.crs, cloud.path)
    if ground == "class_2":
        warn_of_classes(taken.path, taken.xyz, progress)
    return taken


def _record_name(output: Path) -> str:
    return f"{output.stem}_run.json"
