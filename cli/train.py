"""``slopewatch train``: a screening model of one's own."""

from __future__ import annotations

from pathlib import Path

import click

from ..engine.core.run_result import RunResult
from ..interface.parameters import FineTuneParameters, InputParameters, OutputParameters
from .commands import _FILE, _output_dir
from .options import Session, command


@click.command()
@click.argument("clouds", type=_FILE, nargs=-1, required=True, metavar="CLOUD...")
@click.option(
    "--polygons",
    type=_FILE,
    default=None,
    metavar="FILE",
    help="Vector file whose polygons give the points inside them their class, instead of a dimension.",
)
@_output_dir
@command(InputParameters, FineTuneParameters, OutputParameters, profile=False)
def train(session: Session, clouds: tuple[Path, ...], polygons: Path | None, output_dir: Path) -> RunResult:
    """Train a screening model on labelled clouds of ground points, each of one slope, and score it by folds.

    Run again with the same values it goes on where it was stopped.
    """
    from ..workflows.train import train_step

    return train_step(
        clouds,
        output_dir,
        session.parameters(FineTuneParameters),
        session.parameters(InputParameters),
        polygons=polygons,
        overwrite=session.parameters(OutputParameters).overwrite,
        progress=session.report,
    )
