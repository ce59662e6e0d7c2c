"""``slopewatch topview``, ``suggestroi``, ``exportlabelstudio``, ``importlabelstudio``: what is drawn on and drawn."""

from __future__ import annotations

from pathlib import Path

import click

from ..engine.core.run_result import RunResult
from ..interface.parameters import (
    InputParameters,
    LabellingParameters,
    RegionParameters,
    TopViewParameters,
    command_sets,
)
from .options import OUTPUT_DIR, PATH, ROI, Session, command, path_option


@click.command()
@click.argument("cloud", type=PATH)
@ROI
@OUTPUT_DIR
@command(*command_sets.TOPVIEW, profile=False)
def topview(session: Session, cloud: Path, roi: Path | None, output_dir: Path) -> RunResult:
    """CLOUD from above as rasters to draw on: picture, hillshade, densities of all and of ground returns, canopy
    height.
    """
    from ..workflows.topview import topview_step

    return topview_step(
        cloud,
        output_dir,
        session.parameters(TopViewParameters),
        session.parameters(InputParameters),
        roi=roi,
        overwrite=session.overwrite,
        progress=session.report,
    )


@click.command()
@click.argument("cloud", type=PATH)
@path_option("--output", "The proposed region, .gpkg.", required=True)
@command(*command_sets.SUGGESTROI, profile=False)
def suggestroi(session: Session, cloud: Path, output: Path) -> RunResult:
    """Propose a region of interest: the part of CLOUD that is dense and whole enough to be inspected."""
    from ..workflows.suggestroi import suggestroi_step

    return suggestroi_step(
        cloud,
        output,
        session.parameters(RegionParameters),
        session.parameters(InputParameters),
        overwrite=session.overwrite,
        progress=session.report,
    )


@click.command()
@click.argument("picture", type=PATH)
@path_option(
    "--segments", "Vector file whose polygons are shown on the pictures, with their attributes, such as zones."
)
@OUTPUT_DIR
@command(*command_sets.EXPORTLABELSTUDIO, profile=False)
def exportlabelstudio(session: Session, picture: Path, segments: Path | None, output_dir: Path) -> RunResult:
    """PICTURE, a raster of a top view, as pictures and tasks to label in Label Studio."""
    from ..workflows.labelstudio import export_step

    return export_step(
        picture,
        output_dir,
        session.parameters(LabellingParameters),
        segments=segments,
        overwrite=session.overwrite,
        progress=session.report,
    )


@click.command()
@click.argument("export", type=PATH)
@path_option("--tasks", "The tasks.json of exportlabelstudio, with its pictures next to it.", required=True)
@path_option("--output", "The labels, .gpkg.", required=True)
@command(*command_sets.IMPORTLABELSTUDIO, profile=False)
def importlabelstudio(session: Session, export: Path, tasks: Path, output: Path) -> RunResult:
    """EXPORT, a JSON export of Label Studio, to a georeferenced layer of what was drawn."""
    from ..workflows.labelstudio import import_step

    return import_step(export, tasks, output, overwrite=session.overwrite, progress=session.report)
