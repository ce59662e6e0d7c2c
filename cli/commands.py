"""The commands. Each only collects its arguments and calls the engine; late imports keep ``--help`` fast."""

from __future__ import annotations

from pathlib import Path

import click

from ..engine.core.run_result import RunResult
from ..interface.parameters import InputParameters, command_sets
from .options import OUTPUT_DIR, PATH, PROFILES_ALONG, ROI, STABLE, Session, command, pair, path_option, related


@click.command()
@click.option(
    "--epoch",
    "epochs",
    multiple=True,
    required=True,
    metavar="[DATE=]CLOUD",
    help="A survey: the date it was flown (YYYY-MM-DD, else from the file's name) and its LAS or LAZ file. Give two, "
    "the earlier first, or one that is only screened.",
)
@ROI
@STABLE
@PROFILES_ALONG
@related(corrections=True)
@OUTPUT_DIR
@command(*command_sets.INSPECT)
def inspect(
    session: Session,
    epochs: tuple[str, ...],
    roi: Path,
    stable: Path,
    profiles: Path,
    output_dir: Path,
    **layers: Path | None,
) -> RunResult:
    """The whole flow: two raw surveys in, change rasters, hazard zones, a heatmap and a report out.

    The ground of the last survey is also screened, and the result says which screened zones the change confirms. One
    survey alone is only screened.
    """
    from ..engine.core.errors import InputError
    from ..engine.epochs.epoch import parse_epoch
    from ..workflows.inspect import inspect_slope
    from ..workflows.layer_files import LayerFiles
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
        layers=LayerFiles(**layers),
        pdal=session.pdal,
        overwrite=session.overwrite,
        progress=session.report,
    )


@click.command()
@click.argument("cloud", type=PATH)
@ROI
@path_option("--output", "The ground points, .laz or .las.", required=True)
@command(*command_sets.GROUND)
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
@click.argument("reference", type=PATH)
@click.argument("moving", type=PATH)
@path_option("--output", "MOVING in the frame of REFERENCE, .laz.", required=True)
@path_option("--transform", "The rigid motion, MOVING to REFERENCE, as JSON.")
@path_option("--apply", "Apply this transform.json instead of registering.", "given")
@click.option("--invert", is_flag=True, help="Apply the inverse of the transform given with --apply.")
@STABLE
@command(*command_sets.REGISTER)
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
@pair
@STABLE
@PROFILES_ALONG
@related()
@OUTPUT_DIR
@command(*command_sets.CHANGE)
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
    **layers: Path | None,
) -> RunResult:
    """Elevation change, MOVING minus REFERENCE, of two registered ground clouds."""
    from ..workflows.change import change_step
    from ..workflows.layer_files import LayerFiles
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
        layers=LayerFiles(**layers),
        overwrite=session.overwrite,
        progress=session.report,
    )


@click.command()
@click.argument("cloud", type=PATH)
@command(*command_sets.INFO, profile=False)
def info(session: Session, cloud: Path) -> RunResult:
    """What CLOUD holds: header, reference system, extent, density, classes, and what is unusual about it."""
    from ..engine.pointcloud.summary import describe_cloud

    return RunResult({}, describe_cloud(cloud, session.parameters(InputParameters)))


@click.command()
@command(profile=False)
def check(session: Session) -> RunResult:
    """Whether everything that SlopeWatch needs is there and works."""
    from ..workflows.check import check_environment

    return RunResult({}, check_environment(session.pdal))
