"""``slopewatch demchange``: change between elevation models."""

from __future__ import annotations

from pathlib import Path

import click

from ..engine.core.run_result import RunResult
from ..interface.parameters import command_sets
from .options import OUTPUT_DIR, PROFILES_ALONG, STABLE, Session, command, related


@click.command()
@click.argument("models", metavar="[DATE=]DEM [DATE=]DEM...", nargs=-1, required=True)
@STABLE
@PROFILES_ALONG
@related()
@OUTPUT_DIR
@command(*command_sets.DEMCHANGE, profile=False)
def demchange(
    session: Session,
    models: tuple[str, ...],
    stable: Path | None,
    profiles: Path | None,
    output_dir: Path,
    **layers: Path | None,
) -> RunResult:
    """Change between elevation models (GeoTIFF) of two or more dates, the earliest first.

    They may have different grids. Bias and shift of the later ones are found on stable ground and taken off; the level
    of detection follows from slope, curvature and roughness there. With three models or more, each is compared with
    the first and with the one before. A date (YYYY-MM-DD) stands in front of its model, or in the file's name.
    """
    from ..workflows.demchange import demchange_step, parse_model
    from ..workflows.layer_files import LayerFiles
    from ..workflows.settings import ModelSettings, gathered

    return demchange_step(
        [parse_model(model) for model in models],
        output_dir,
        gathered(ModelSettings, session.parameters),
        stable=stable,
        profiles=profiles,
        layers=LayerFiles(**layers),
        overwrite=session.overwrite,
        progress=session.report,
    )
