"""``slopewatch screen``: one survey, labelled."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import click

from ..engine.core.run_result import RunResult
from ..interface.parameters import GroundParameters, InputParameters, ScreeningParameters
from .commands import _FILE, _roi
from .options import Session, command


@click.command()
@click.argument("cloud", type=_FILE)
@_roi
@click.option(
    "--output", type=_FILE, required=True, metavar="FILE", help="The labelled cloud, NAME.laz; NAME_run.json beside it."
)
@click.option(
    "--zones", type=_FILE, default=None, metavar="FILE", help="Hazard polygons, .gpkg.  [default: NAME_zones.gpkg]"
)
@click.option(
    "--raster",
    type=_FILE,
    default=None,
    metavar="FILE",
    help="Probabilities of a hazard, of uplift and of subsidence, .tif.  [default: NAME_probability.tif]",
)
@click.option(
    "--map", "picture", type=_FILE, default=None, metavar="FILE", help="Picture, .png.  [default: NAME_map.png]"
)
@click.option("--method", type=click.Choice(["network", "residual"]), default=None, help="As --screening-method.")
@command(InputParameters, ScreeningParameters, GroundParameters)
def screen(
    session: Session,
    cloud: Path,
    roi: Path | None,
    output: Path,
    zones: Path | None,
    raster: Path | None,
    picture: Path | None,
    method: str | None,
) -> RunResult:
    """Find ground in CLOUD, one survey, that looks raised or lowered against the slope around it.

    CLOUD holds ground points; with --ground extract it may be a raw survey.
    """
    from ..workflows.products.screening import default_targets
    from ..workflows.screen import screen_step
    from ..workflows.settings import ScreeningSettings, gathered

    if method is not None:
        session = dataclasses.replace(session, values={**session.values, "screening_method": method})
    settings = gathered(ScreeningSettings, session.parameters)
    targets = default_targets(output, zones, raster, picture)
    return screen_step(cloud, targets, settings, roi=roi, pdal=session.pdal, progress=session.report)
