"""``slopewatch compareflight``: the survey that was flown, and its plan."""

from __future__ import annotations

from pathlib import Path

import click

from ..engine.core.run_result import RunResult
from ..interface.parameters import InputParameters, command_sets
from .options import OUTPUT_DIR, PATH, Session, command, path_option


@click.command()
@click.argument("plan", type=PATH)
@click.argument("cloud", type=PATH)
@path_option("--ground", "Its ground, as `slopewatch ground` writes it; without it, the cloud's class 2.")
@path_option(
    "--trajectory", "CSV with time, x, y and z of the carrier; without it, its way is that of the scan angles."
)
@OUTPUT_DIR
@command(*command_sets.COMPAREFLIGHT, profile=False)
def compareflight(
    session: Session, plan: Path, cloud: Path, ground: Path | None, trajectory: Path | None, output_dir: Path
) -> RunResult:
    """Compare the survey CLOUD with the PLAN (plan.gpkg) by which it was flown: lines left out or flown elsewhere, and
    places whose returns or ground returns fell short of what was promised.
    """
    from ..workflows.compareflight import compareflight_step

    return compareflight_step(
        plan,
        cloud,
        output_dir,
        session.parameters(InputParameters),
        ground=ground,
        trajectory=trajectory,
        overwrite=session.overwrite,
        progress=session.report,
    )
