"""The commands. Each only gathers its arguments and calls the engine; imports are late to keep ``--help`` quick."""

from __future__ import annotations

from pathlib import Path

import click

from ..engine.core.run_result import RunResult
from ..interface.parameters import (
    ChangeParameters,
    DateParameters,
    GroundParameters,
    HeatmapParameters,
    InputParameters,
    LastEpochParameters,
    OutputParameters,
    RegistrationParameters,
    ReportParameters,
    SurfaceParameters,
    ZoneParameters,
)
from .options import Session, command
from .report import PROFILES_OPTION

_FILE = click.Path(path_type=Path)
_roi = click.option(
    "--roi", type=_FILE, default=None, metavar="FILE", help="Vector file whose polygons bound the managed slope."
)
_stable = click.option(
    "--stable", type=_FILE, default=None, metavar="FILE", help="Vector file whose polygons are known to be stable."
)
_output_dir = click.option(
    "--output-dir", type=_FILE, required=True, metavar="DIR", help="Folder for the outputs; made if missing."
)


@click.command()
@click.option(
    "--epoch",
    "epochs",
    multiple=True,
    required=True,
    metavar="DATE=CLOUD",
    help="A survey: the date it was flown (YYYY-MM-DD) and its LAS or LAZ file. Give two, the earlier first, or one "
    "that is screened only.",
)
@_roi
@_stable
@PROFILES_OPTION
@_output_dir
@command(
    InputParameters,
    DateParameters,
    GroundParameters,
    RegistrationParameters,
    ChangeParameters,
    ZoneParameters,
    HeatmapParameters,
    ReportParameters,
    LastEpochParameters,
    OutputParameters,
)
def inspect(
    session: Session, epochs: tuple[str, ...], roi: Path, stable: Path, profiles: Path, output_dir: Path
) -> RunResult:
    """The whole flow: two raw surveys in, change rasters, hazard zones, a heatmap and a report out.

    The ground of the last survey is screened, too, and the change says which of the zones found so it confirms. One
    survey alone is screened only.
    """
    from ..engine.core.errors import InputError
    from ..engine.epochs.epoch import parse_epoch
    from ..workflows.inspect import inspect_slope
    from ..workflows.settings import Settings, gathered

    if len(epochs) > 2:
        raise InputError(f"--epoch was given {len(epochs)} times; give two epochs, the earlier first.")
    return inspect_slope(
        [parse_epoch(e) for e in epochs],
        output_dir,
        gathered(Settings, session.parameters),
        roi=roi,
        stable=stable,
        profiles=profiles,
        pdal=session.pdal,
        overwrite=session.parameters(OutputParameters).overwrite,
        progress=session.report,
    )


@click.command()
@click.argument("cloud", type=_FILE)
@_roi
@click.option("--output", type=_FILE, required=True, metavar="FILE", help="The ground points, .laz or .las.")
@command(InputParameters, GroundParameters)
def ground(session: Session, cloud: Path, roi: Path, output: Path) -> RunResult:
    """Clip CLOUD to the slope, remove outliers and extract the ground under the vegetation."""
    from ..workflows.ground import ground_step
    from ..workflows.settings import Settings, gathered

    return ground_step(
        cloud,
        output,
        gathered(Settings, session.parameters),
        roi=roi,
        pdal=session.pdal,
        progress=session.report,
    )


@click.command()
@click.argument("reference", type=_FILE)
@click.argument("moving", type=_FILE)
@click.option("--output", type=_FILE, required=True, metavar="FILE", help="MOVING in the frame of REFERENCE, .laz.")
@click.option(
    "--transform", type=_FILE, default=None, metavar="FILE", help="The rigid motion, MOVING to REFERENCE, as JSON."
)
@click.option(
    "--apply",
    "given",
    type=_FILE,
    default=None,
    metavar="FILE",
    help="Apply this transform.json instead of registering.",
)
@click.option("--invert", is_flag=True, help="Apply the inverse of the transform given with --apply.")
@_stable
@command(InputParameters, SurfaceParameters, RegistrationParameters)
def register(
    session: Session,
    reference: Path,
    moving: Path,
    output: Path,
    transform: Path | None,
    given: Path | None,
    invert: bool,
    stable: Path | None,
) -> RunResult:
    """Move the cloud MOVING into the frame of REFERENCE. Both should be ground points.

    With --ground class_2 those of class 2 are registered, and all of MOVING is moved.
    """
    from ..workflows.register import register_step
    from ..workflows.settings import Settings, gathered

    return register_step(
        reference,
        moving,
        output,
        gathered(Settings, session.parameters),
        transform_path=transform,
        given=given,
        invert=invert,
        stable=stable,
        progress=session.report,
    )


@click.command()
@click.argument("reference", type=_FILE)
@click.argument("moving", type=_FILE)
@click.option("--epoch-from", default=None, metavar="DATE", help="Date of REFERENCE; else from its file name.")
@click.option("--epoch-to", default=None, metavar="DATE", help="Date of MOVING; else from its file name.")
@click.option("--transform", type=_FILE, default=None, metavar="FILE", help="transform.json to apply to MOVING first.")
@_stable
@PROFILES_OPTION
@_output_dir
@command(
    InputParameters,
    DateParameters,
    SurfaceParameters,
    ChangeParameters,
    ZoneParameters,
    HeatmapParameters,
    ReportParameters,
    OutputParameters,
)
def change(
    session: Session,
    reference: Path,
    moving: Path,
    epoch_from: str | None,
    epoch_to: str | None,
    transform: Path | None,
    stable: Path | None,
    profiles: Path | None,
    output_dir: Path,
) -> RunResult:
    """Elevation change, MOVING minus REFERENCE, of two registered ground clouds."""
    from ..workflows.change import change_step
    from ..workflows.settings import Settings, gathered

    return change_step(
        reference,
        moving,
        output_dir,
        gathered(Settings, session.parameters),
        dates=(epoch_from, epoch_to),
        transform_path=transform,
        stable=stable,
        profiles=profiles,
        overwrite=session.parameters(OutputParameters).overwrite,
        progress=session.report,
    )


@click.command()
@click.argument("cloud", type=_FILE)
@command(InputParameters, profile=False)
def info(session: Session, cloud: Path) -> RunResult:
    """What CLOUD holds: header, reference system, extent, density, classes, and what is odd about it."""
    from ..engine.pointcloud.summary import describe_cloud

    return RunResult({}, describe_cloud(cloud, session.parameters(InputParameters)))


@click.command()
@command(profile=False)
def check(session: Session) -> RunResult:
    """Whether everything that SlopeWatch needs is there and works."""
    from ..workflows.check import check_environment

    return RunResult({}, check_environment(session.pdal))
