"""The program ``slopewatch``: its commands together."""

from __future__ import annotations

import sys
from typing import Any

import click

from ..engine.core.errors import InputError
from ..engine.core.version import VERSION
from .batch import batch
from .commands import change, check, ground, info, inspect, register
from .compareflight import compareflight
from .createproject import createproject
from .demchange import demchange
from .displacement import displacement
from .drawing import exportlabelstudio, importlabelstudio, suggestroi, topview
from .exportgis import exportgis
from .help_pages import Program
from .language import say
from .locate import locate
from .m3c2 import m3c2
from .parameters import parameters
from .planflight import planflight
from .report import report
from .reporting import error_event
from .screen import screen
from .series import series
from .simulate import simulate
from .train import train


class _Program(Program):
    """Options that cannot be understood are reported as JSON, too, where that is asked for."""

    def invoke(self, ctx: click.Context) -> Any:
        try:
            return super().invoke(ctx)
        except click.UsageError as error:
            if "--progress json" in " ".join(sys.argv).replace("=", " "):
                click.echo(error_event(InputError(error.format_message())))
            raise click.UsageError(say(error.format_message()), error.ctx) from error


@click.group(cls=_Program, context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 110})
@click.version_option(VERSION, prog_name="slopewatch")
def cli() -> None:
    """Change and hazards of road slopes from UAV LiDAR surveys.

    Lengths are in metres. Exit codes: 0 all outputs were written and checked, 2 something given cannot be used,
    3 some slopes of a batch failed, 1 internal failure, 130 cancelled.
    """


for subcommand in (
    inspect,
    ground,
    register,
    change,
    demchange,
    m3c2,
    displacement,
    locate,
    screen,
    series,
    batch,
    report,
    exportgis,
    createproject,
    topview,
    suggestroi,
    exportlabelstudio,
    importlabelstudio,
    info,
    planflight,
    compareflight,
    train,
    simulate,
    check,
    parameters,
):
    cli.add_command(subcommand)
