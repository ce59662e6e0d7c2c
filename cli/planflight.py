"""``slopewatch planflight``: the flight of the next survey."""

from __future__ import annotations

from pathlib import Path

import click

from ..engine.core.run_result import RunResult
from ..interface.parameters import FlightParameters, InputParameters, MissionParameters, command_sets
from .options import OUTPUT_DIR, PATH, Session, command, path_option


@click.command()
@click.argument("terrain", type=PATH)
@path_option("--roi", "Vector file whose polygons are to be surveyed.", required=True)
@path_option("--survey", "The last survey with its plants, which shows how many pulses reach the ground.")
@path_option("--plan", "The plan.gpkg of an earlier plan, whose lines are flown again over this terrain.")
@click.option(
    "--season",
    multiple=True,
    metavar="[DATE=]CLOUD",
    help="A classified survey of a known date (YYYY-MM-DD, else from the file's name), or a folder or manifest of "
    "them. Give two or more of different months: the one in which most pulses reached the ground is named.",
)
@OUTPUT_DIR
@command(*command_sets.PLANFLIGHT, profile=False)
def planflight(
    session: Session,
    terrain: Path,
    roi: Path,
    survey: Path | None,
    plan: Path | None,
    season: tuple[str, ...],
    output_dir: Path,
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
        mission=session.parameters(MissionParameters),
        survey=survey,
        plan=plan,
        season=season,
        overwrite=session.overwrite,
        progress=session.report,
    )
