"""``slopewatch train``: a screening model from the user's own clouds."""

from __future__ import annotations

from pathlib import Path

import click

from ..engine.core.run_result import RunResult
from ..interface.parameters import FineTuneParameters, InputParameters, command_sets
from .options import OUTPUT_DIR, PATH, Session, command, path_option


@click.command()
@click.argument("clouds", type=PATH, nargs=-1, required=True, metavar="CLOUD...")
@path_option(
    "--polygons", "Vector file whose polygons give the points inside them their class, instead of a dimension."
)
@OUTPUT_DIR
@command(*command_sets.TRAIN, profile=False)
def train(session: Session, clouds: tuple[Path, ...], polygons: Path | None, output_dir: Path) -> RunResult:
    """Train a screening model on labelled clouds of ground points, each of one slope, and score it by folds.

    A stopped training continues when it is run again with the same values.
    """
    from ..workflows.train import train_step

    return train_step(
        clouds,
        output_dir,
        session.parameters(FineTuneParameters),
        session.parameters(InputParameters),
        polygons=polygons,
        overwrite=session.overwrite,
        progress=session.report,
    )
