"""``slopewatch m3c2``: the distance of two clouds along the surface's normal."""

from __future__ import annotations

from pathlib import Path

import click

from ..engine.core.run_result import RunResult
from ..interface.parameters import (
    DateParameters,
    DistanceParameters,
    InputParameters,
    OutputParameters,
    SurfaceParameters,
)
from .commands import _FILE
from .options import Session, command


@click.command()
@click.argument("reference", type=_FILE)
@click.argument("moving", type=_FILE)
@click.option(
    "--output", type=_FILE, required=True, metavar="FILE", help="The core points, NAME.laz; NAME_run.json beside it."
)
@click.option(
    "--output-dir",
    type=_FILE,
    default=None,
    metavar="DIR",
    help="Folder for the rasters; made if missing.  [default: that of the core points]",
)
@click.option(
    "--core",
    type=_FILE,
    default=None,
    metavar="FILE",
    help="Cloud of the points to measure at.  [default: points of REFERENCE, evenly spread]",
)
@click.option("--epoch-from", default=None, metavar="DATE", help="Date of REFERENCE; else from its file name.")
@click.option("--epoch-to", default=None, metavar="DATE", help="Date of MOVING; else from its file name.")
@click.option("--transform", type=_FILE, default=None, metavar="FILE", help="transform.json to apply to MOVING first.")
@click.option(
    "--stable",
    type=_FILE,
    default=None,
    metavar="FILE",
    help="Polygons of ground that has surely not moved.  [default: found in the distances]",
)
@command(InputParameters, DateParameters, SurfaceParameters, DistanceParameters, OutputParameters, profile=False)
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
    stable: Path | None,
) -> RunResult:
    """Distance of MOVING from REFERENCE, two registered ground clouds, along the surface's normal (M3C2).

    For faces too steep for a difference of heights. It does not see what slides along the surface.
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
        stable=stable,
        overwrite=session.parameters(OutputParameters).overwrite,
        progress=session.report,
    )
