"""Command line options made from the parameter groups, and what all commands share."""

from __future__ import annotations

import contextlib
import functools
import os
import sys
import traceback
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import click

from ..engine.core import cancellation
from ..engine.core.errors import EngineError, InputError, SlopeWatchError
from ..engine.core.run_result import RunResult
from ..interface.parameters import AUTO, PROFILES, ParameterError, ParameterSet, Specification
from .reporting import Reporter, reporter

Command = Callable[..., Any]
Group = TypeVar("Group", bound=ParameterSet)


@dataclass(frozen=True)
class Session:
    """What a command gets in addition to its own arguments: where to report, which PDAL, and the options given."""

    report: Reporter
    pdal: Path | None
    profile: str
    values: dict[str, Any]

    def parameters(self, group: type[Group]) -> Group:
        """The parameter group: the profile's values overridden by the options given."""
        return group.build(self.values, self.profile)


class _NumberOrAuto(click.ParamType):
    """A number, or the word that leaves it to the data, which is 0."""

    name = "number"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> float:
        if value == AUTO:
            return 0.0
        try:
            return float(value)
        except ValueError:
            self.fail(f"{value!r} is neither a number nor {AUTO}.", param, ctx)


def _option(specification: Specification) -> Callable[[Command], Command]:
    name = specification.option
    default: Any = specification.default
    if specification.kind is bool:
        default = "yes" if default else "no"
    unit = f" {specification.unit}" if specification.unit else ""
    bounds, least = "", specification.minimum if specification.automatic is None else specification.automatic
    if least is not None and specification.maximum is not None and not specification.choices:
        bounds = f", {least:g} to {specification.maximum:g}"
    if specification.automatic is not None and default == 0:
        default, unit, bounds = AUTO, "", f"{bounds}{unit}"
    shown = f"{specification.help}  [default: {default if default != '' else 'none'}{unit}{bounds}]"
    if specification.kind is bool:
        return click.option(f"--{name}/--no-{name}", specification.name, default=None, help=shown)
    kind: Any = {int: int, float: float, str: str}[specification.kind]
    if specification.automatic is not None:
        kind = _NumberOrAuto()
    if specification.choices:
        kind = click.Choice(specification.choices)
    metavar = None if specification.choices else (specification.unit or specification.kind.__name__).upper()
    return click.option(f"--{name}", specification.name, type=kind, default=None, help=shown, metavar=metavar)


def command(*groups: type[ParameterSet], profile: bool = True) -> Callable[[Command], Command]:
    """Decorate a command: it gets a ``Session``, options for ``groups``, and the exit codes of the errors."""

    def decorate(function: Command) -> Command:
        names = [s.name for group in groups for s in group.specifications()]

        @functools.wraps(function)
        def run(*, progress: str, watch_parent: bool, pdal: Path | None, debug: bool, **arguments: Any) -> None:
            values = {name: arguments.pop(name) for name in names}
            report = reporter(progress)
            cancellation.install(report.cancelled, watch_parent=watch_parent)
            session = Session(report, pdal, arguments.pop("profile", "default"), values)
            sys.exit(_run(report, debug, lambda: function(session, **arguments)))

        wrapped: Command = run
        for group in reversed(groups):
            for specification in reversed(group.specifications()):
                wrapped = _option(specification)(wrapped)
        if profile:
            wrapped = click.option(
                "--profile",
                type=click.Choice(list(PROFILES)),
                default="default",
                show_default=True,
                help="paper: the published settings. Options given beside it override it.",
            )(wrapped)
        for shared in (
            click.option("--debug", is_flag=True, help="Show the traceback of an internal failure."),
            click.option(
                "--pdal", type=click.Path(path_type=Path), help="The pdal program to use, if another than found."
            ),
            click.option("--watch-parent", is_flag=True, help="Stop when standard input closes."),
            click.option(
                "--progress",
                type=click.Choice(["auto", "bar", "json", "none"]),
                default="auto",
                show_default=True,
                help="How progress is told. json: one object a line on standard output.",
            ),
        ):
            wrapped = shared(wrapped)
        return wrapped

    return decorate


def _run(report: Reporter, debug: bool, work: Callable[[], RunResult]) -> int:
    error: SlopeWatchError
    try:
        with report:
            done = work()
        missing = [path for path in done.outputs.values() if not path.exists()]
        if missing:
            raise EngineError(f"{missing[0]} was promised but does not exist")
        with contextlib.suppress(BrokenPipeError):  # as by `| head`: all is written, and who reads has read enough
            report.result(done.outputs, done.figures)
        _flush_or_drop()
        return 0
    except SlopeWatchError as known:
        error = known
    except ParameterError as wrong:
        error = InputError(f"{wrong}.")
    except BrokenPipeError:
        error = EngineError(
            "Who read the progress, or a program that this run had started, ended early; nothing was written."
        )
    except MemoryError:
        error = EngineError("Memory ran out; clip the cloud to the slope or use a larger cell.")
    except Exception as unexpected:  # the last resort: an internal failure in one sentence
        if debug:
            traceback.print_exc()
        place = traceback.extract_tb(unexpected.__traceback__)[-1]
        error = EngineError(
            f"Internal failure: {type(unexpected).__name__}: {unexpected} "
            f"({Path(place.filename).name}, line {place.lineno}); run again with --debug for details."
        )
    with contextlib.suppress(BrokenPipeError):
        report.error(error)
    _flush_or_drop()
    return error.exit_code


def _flush_or_drop() -> None:
    """Write out what standard output holds; where nobody reads it any more, drop it, so that the exit is quiet."""
    try:
        sys.stdout.flush()
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
