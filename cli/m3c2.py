"""``slopewatch m3c2``: the distance of two clouds along the surface's normal."""

from __future__ import annotations

from pathlib import Path

import click

from ..engine.core.run_result import RunResult
from ..interface.parameters import OutputParameters, command_sets
from .options import ROI, Session, command, pair, path_option


@click.command()
@pair
@path_option(
    "--output", "The core points, NAME.laz; NAME_run.json and NAME_report.html are written next to it.", required=True
)
@path_option(
    "--output-dir",
    "Folder for the rasters and zones; created if missing.  [default: that of the core points]",
    metavar="DIR",
)
@path_option("--core", "Cloud of the points to measure at.  [default: points of REFERENCE, evenly spread]")
@ROI
@path_option("--stable", "Polygons of ground that has not moved.  [default: found in the distances]")
@command(*command_sets.M3C2, OutputParameters, profile=False)
def m3c2(
    session: Session,
    reference: Path,
    moving: Path,
    output: Path,
    output_dir: Path | None,
    core: Path | None,
    epoch_from: str | None,
    epoch_to: str | None,
    transform: Path | None,
    roi: Path | None,
    stable: Path | None,
) -> RunResult:
    """Distance of MOVING from REFERENCE, two registered ground clouds, along the surface's normal (M3C2).

    For faces too steep for a difference of heights. Significant distances make zones with volumes. Ground that slides
    along the surface is not detected.
    """
    from ..workflows.m3c2 import m3c2_step
    from ..workflows.settings import DistanceSettings, gathered

    return m3c2_step(
        reference,
        moving,
        output,
        gathered(DistanceSettings, session.parameters),
        raster_dir=output_dir,
        core=core,
        dates=(epoch_from, epoch_to),
        transform_path=transform,
        roi=roi,
        stable=stable,
        overwrite=session.overwrite,
        progress=session.report,
    )
