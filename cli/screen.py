"""``slopewatch screen``: one survey, labelled."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import click

from ..engine.core.run_result import RunResult
from ..interface.parameters import ScreeningParameters, command_sets
from .options import PATH, ROI, Session, command, path_option, related

_METHODS = next(s.choices for s in ScreeningParameters.specifications() if s.name == "screening_method")


@click.command()
@click.argument("cloud", type=PATH)
@ROI
@related(classes=False)
@path_option("--output", "The labelled cloud, NAME.laz; NAME_run.json is written next to it.", required=True)
@path_option("--zones", "Hazard polygons, .gpkg.  [default: NAME_zones.gpkg]")
@path_option(
    "--raster", "Probabilities of a hazard, of uplift and of subsidence, .tif.  [default: NAME_probability.tif]"
)
@path_option(
    "--smallest-hazard",
    "Heights that hazards 2, 3, 5 and 8 m wide need to be found, .tif.  [default: NAME_smallest_hazard.tif]",
)
@path_option("--map", "Picture, .png.  [default: NAME_map.png]", "picture")
@click.option("--method", type=click.Choice(_METHODS), default=None, help="Same as --screening-method.")
@command(*command_sets.SCREEN)
def screen(
    session: Session,
    cloud: Path,
    roi: Path | None,
    output: Path,
    zones: Path | None,
    raster: Path | None,
    smallest_hazard: Path | None,
    picture: Path | None,
    method: str | None,
    **layers: Path | None,
) -> RunResult:
    """Find ground in CLOUD, one survey, that looks raised or lowered against the slope around it.

    CLOUD holds ground points; with --ground extract it may be a raw survey.
    """
    from ..workflows.layer_files import LayerFiles
    from ..workflows.products.screening import default_targets
    from ..workflows.screen import screen_step
    from ..workflows.settings import ScreeningSettings, gathered

    if method is not None:
        session = dataclasses.replace(session, values={**session.values, "screening_method": method})
    settings = gathered(ScreeningSettings, session.parameters)
    targets = default_targets(output, zones, raster, picture, smallest_hazard)
    files = LayerFiles(**layers)
    return screen_step(cloud, targets, settings, roi=roi, layers=files, pdal=session.pdal, progress=session.report)
