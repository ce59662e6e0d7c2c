"""``slopewatch planflight``: the flight of the next survey."""

from __future__ import annotations

from pathlib import Path

import click

from ..engine.core.run_result import RunResult
from ..interface.parameters import FlightParameters, InputParameters, command_sets
from .options import OUTPUT_DIR, PATH, Session, command, path_option


@click.command()
@click.argument("terrain", type=PATH)
@path_option("--roi", "Vector file whose polygons are to be surveyed.", required=True)
@path_option("--survey", "The last survey with its plants, which shows how many pulses reach the ground.")
@path_option("--plan", "The plan.gpkg of an earlier plan, whose lines are flown again over this terrain.")
@OUTPUT_DIR
@command(*command_sets.PLANFLIGHT, profile=False)
def planflight(
    session: Session, terrain: Path, roi: Path, survey: Path | None, plan: Path | None, output_dir: Path
) -> RunResult:
    """Lines and waypoints of the next survey over TERRAIN, an elevation model or the last survey's ground, and what
    it will show: returns, ground under the plants, level of detection and smallest motion place by place.
    """
    from ..workflows.planflight import planflight_step

    return planflight_step(
        terrain,
        roi,
        output_dir,
        session.parameters(FlightParameters),
        session.parameters(InputParameters),
        survey=survey,
        plan=plan,
        overwrite=session.overwrite,
        progress=session.report,
    )
