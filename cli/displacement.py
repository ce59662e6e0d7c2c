"""``slopewatch displacement``: how far ground has moved along its surface."""

from __future__ import annotations

from pathlib import Path

import click

from ..engine.core.run_result import RunResult
from ..interface.parameters import command_sets
from .options import Session, command, pair, path_option, related


@click.command()
@pair
@path_option(
    "--output-dir", "Folder for the rasters, vectors and the record; created if missing.", required=True, metavar="DIR"
)
@path_option("--stable", "Polygons of ground that has not moved; its motion is taken off all vectors.")
@related(classes=False)
@command(*command_sets.DISPLACEMENT, profile=False)
def displacement(
    session: Session,
    reference: Path,
    moving: Path,
    output_dir: Path,
    epoch_from: str | None,
    epoch_to: str | None,
    transform: Path | None,
    stable: Path | None,
    **layers: Path | None,
) -> RunResult:
    """How far MOVING has moved along the surface against REFERENCE, two registered ground clouds, as vectors.

    Slopes creep along their surface, which change and m3c2 hardly see. It needs relief that both surveys share.
    """
    from ..workflows.displacement import displacement_step
    from ..workflows.layer_files import LayerFiles
    from ..workflows.settings import DisplacementSettings, gathered

    return displacement_step(
        reference,
        moving,
        output_dir,
        gathered(DisplacementSettings, session.parameters),
        dates=(epoch_from, epoch_to),
        transform_path=transform,
        stable=stable,
        layers=LayerFiles(**layers),
        overwrite=session.overwrite,
        progress=session.report,
    )
