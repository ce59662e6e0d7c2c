"""``slopewatch locate``: places of a layer on a road."""

from __future__ import annotations

from pathlib import Path

import click

from ..engine.core.run_result import RunResult
from ..interface.parameters import RoadParameters, command_sets
from .options import PATH, Session, command, path_option


@click.command()
@click.argument("source", type=PATH, metavar="LAYER")
@path_option("--centreline", "Vector file with the road's axis.", required=True)
@path_option("--output", "The layer with route, chainage, side and offset, .gpkg.", required=True)
@click.option("--layer", default="", metavar="NAME", help="Layer of a file with several; else its first one.")
@path_option("--field-names", "JSON or CSV file with your names of the fields, both read and written.")
@command(*command_sets.LOCATE, profile=False)
def locate(
    session: Session, source: Path, centreline: Path, output: Path, layer: str, field_names: Path | None
) -> RunResult:
    """Where the polygons, lines or points of LAYER lie on a road, such as the zones.gpkg of a former run.

    Side and chainage are in the direction of growing chainage. What lies equally near to two roads, beyond the end of
    one or out of reach is named and gets no place.
    """
    from ..workflows.layer_files import LayerFiles
    from ..workflows.locate import locate_step

    return locate_step(
        source,
        output,
        LayerFiles(centreline, field_names),
        session.parameters(RoadParameters),
        layer=layer,
        overwrite=session.overwrite,
        progress=session.report,
    )
