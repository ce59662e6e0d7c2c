"""Command line options made from the parameter groups, and what all commands share."""

from __future__ import annotations

import contextlib
import errno
import functools
import os
import sys
import traceback
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import click

from ..engine.core import cancellation, temporary_folders
from ..engine.core.errors import EngineError, InputError, SlopeWatchError
from ..engine.core.input_files import refuse_unusable
from ..engine.core.messages import shown
from ..engine.core.part_folders import settle_around
from ..engine.core.run_result import RunResult
from ..engine.core.temporary_folders import VARIABLE
from ..interface.parameters import AUTO, PROFILES, OutputParameters, ParameterError, ParameterSet, Specification
from ..interface.settings_file import read_assignments, read_settings
from ..workflows.conclusions import conclusion
from .help_pages import RUNNING, command_name, grouped_option
from .language import LANGUAGE
from .reporting import Reporter, reporter, say_of_formats

Command = Callable[..., Any]
_SHOWN = 300  # characters of a name
_OF_FILES = (
    errno.ENAMETOOLONG, errno.ELOOP, errno.ENOTDIR, errno.EISDIR, errno.EACCES, errno.EPERM, errno.EROFS, errno.ENOENT,
    errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO,
)  # fmt: skip
PATH = click.Path(path_type=Path)


def path_option(
    name: str, text: str, *parameter: str, required: bool = False, metavar: str = "FILE"
) -> Callable[[Command], Command]:
    """An option for a file or folder; ``parameter`` is its name in the function where that is another one."""
    return click.option(name, *parameter, type=PATH, required=required, default=None, metavar=metavar, help=text)


ROI = path_option("--roi", "Vector file whose polygons bound the managed slope.")
STABLE = path_option("--stable", "Vector file whose polygons are known to be stable.")
PROFILES_ALONG = path_option("--profiles", "Vector file whose lines profiles are taken along.")
OUTPUT_DIR = path_option("--output-dir", "Folder for the outputs; created if missing.", required=True, metavar="DIR")


def related(*, classes: bool = True, corrections: bool = False) -> Callable[[Command], Command]:
    """The options for ``LayerFiles``, which a command takes as ``**layers``; not all take each of them."""

    def decorate(function: Command) -> Command:
        texts = (
            ("--corrections", "Vector file whose polygons exclude areas, or force or forbid ground (field action)."),
            ("--classes", "Vector file whose polygons are classes of asset; the change is summed up for each class."),
            ("--field-names", "JSON or CSV file with your names of the centreline's fields."),
            ("--centreline", "Vector file with the road's axis; zones get route, chainage, side and offset."),
        )
        left_out = {"--classes": not classes, "--corrections": not corrections}
        for name, text in texts:
            if not left_out.get(name):
                function = path_option(name, text)(function)
        return function

    return decorate


def pair(function: Command) -> Command:
    """The arguments of two clouds: which, of which days, and what moves the later one first."""
    for decorate in (
        path_option("--transform", "transform.json to apply to MOVING first."),
        click.option("--epoch-to", default=None, metavar="DATE", help="Date of MOVING; else from its file name."),
        click.option("--epoch-from", default=None, metavar="DATE", help="Date of REFERENCE; else from its file name."),
        click.argument("moving", type=PATH),
        click.argument("reference", type=PATH),
    ):
        function = decorate(function)
    return function


Group = TypeVar("Group", bound=ParameterSet)


@dataclass(frozen=True)
class Session:
    """What a command gets in addition to its own arguments: where to report, which PDAL, its parameter groups, and the
    options given.
    """

    report: Reporter
    pdal: Path | None
    profile: str
    groups: tuple[type[ParameterSet], ...]
    values: dict[str, Any]

    def parameters(self, group: type[Group]) -> Group:
        """The parameter group: the profile's values overridden by the options given, which are of the command's own."""
        own = any(issubclass(one, group) or issubclass(group, one) for one in self.groups)
        return group.build(self.values if own else {}, self.profile)

    @property
    def overwrite(self) -> bool:
        return self.parameters(OutputParameters).overwrite


@dataclass(frozen=True)
class _NumberOrAuto(click.ParamType):
    """A number of the kind, or the word that leaves it to the data."""

    kind: type
    name = "number"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        try:
            return value if value == AUTO else self.kind(value)
        except ValueError:
            self.fail(f"{value!r} is neither a number nor {AUTO}.", param, ctx)


def _option(specification: Specification, heading: str = "") -> Callable[[Command], Command]:
    s, flag = specification, f"--{specification.option}"
    option = functools.partial(grouped_option, heading, advanced=s.advanced)
    default: Any = ("yes" if s.default else "no") if s.kind is bool else "none" if s.default == "" else s.default
    unit = f" {s.unit}" if s.unit else ""
    bounds = ""
    if s.minimum is not None and s.maximum is not None:
        bounds = f", {s.minimum:g} to {s.maximum:g}"
    if s.automatic:
        unit, bounds = "", f"{bounds}{unit}"
    shown = f"{s.help}  [default: {default}{unit}{bounds}]"
    if s.kind is bool:
        return option(f"{flag}/--no-{s.option}", s.name, default=None, help=shown)
    if s.choices:
        return option(flag, s.name, type=click.Choice(s.choices), default=None, help=shown)
    kind: Any = _NumberOrAuto(s.kind) if s.automatic else s.kind
    metavar = (s.unit or s.kind.__name__).upper()
    return option(flag, s.name, type=kind, default=None, help=shown, metavar=metavar)


def _running(*names: str, **given: Any) -> Callable[[Command], Command]:
    return grouped_option(RUNNING, *names, **given)


_SETTINGS = (
    _running(
        "--settings",
        type=PATH,
        default=None,
        metavar="FILE",
        help="Settings of a former run (its run.json), or a JSON or TOML file of names and values, such as "
        '{"cell": 0.2}. What is given on the command line overrides them. Paths are not taken from it.',
    ),
    _running(
        "--profile",
        type=click.Choice(list(PROFILES)),
        default=None,
        help="paper: the published settings. Options and settings that are also given override it.  [default: default]",
    ),
)
_SET = _running(
    "--set",
    "assignments",
    multiple=True,
    metavar="NAME=VALUE",
    help="A parameter by its name, or by group and name, such as ground.cloth_resolution=0.3. It overrides --settings.",
)
_RUNNING = (
    _running("--language", **LANGUAGE),
    _running("--debug", advanced=True, is_flag=True, help="Show the traceback of an internal failure."),
    _running(
        "--pdal",
        advanced=True,
        type=PATH,
        default=None,
        metavar="FILE",
        help="The pdal program, if not the one that is found.",
    ),
    _running(
        "--temporary-folder",
        advanced=True,
        type=PATH,
        default=None,
        metavar="DIR",
        help=f"Folder for temporary files.  [default: the folder in {VARIABLE}, else the system's]",
    ),
    _running("--watch-parent", advanced=True, is_flag=True, help="Stop when standard input closes."),
    _running(
        "--progress",
        type=click.Choice(["auto", "bar", "json", "none"]),
        default="auto",
        show_default=True,
        help="How progress is reported. json: one object per line on standard output, the last with all figures.",
    ),
)


def _with_settings(
    path: Path | None,
    groups: Sequence[type[ParameterSet]],
    values: dict[str, Any],
    profile: str | None,
    report: Reporter,
) -> tuple[dict[str, Any], str]:
    """The options and the profile of a run: those given, else those of the file, else the profile's values."""
    if path is None:
        return values, profile or "default"
    settle_around(path)
    read = read_settings(path, groups)
    chosen = profile or read.profile or "default"
    given = {name: value for name, value in values.items() if value is not None}
    taken = {name: value for name, value in read.over(groups, chosen).items() if name not in given}
    words = ", ".join(f"{name} {value}" for name, value in taken.items())
    report.info(f"Settings of {shown(path)}: {words or 'as they are without it'}.")
    if read.left_out:
        report.info(f"Not taken from it, as this command has no such settings: {', '.join(read.left_out)}.")
    return values | taken, chosen


def command(*groups: type[ParameterSet], profile: bool = True) -> Callable[[Command], Command]:
    """Decorate a command: it gets a ``Session``, options for ``groups``, and the exit codes of the errors."""

    def decorate(function: Command) -> Command:
        names = [s.name for group in groups for s in group.specifications()]

        @functools.wraps(function)
        def run(*, progress: str, watch_parent: bool, pdal: Path | None, debug: bool, **arguments: Any) -> None:
            values = {name: arguments.pop(name) for name in names}
            temporary: Path | None = arguments.pop("temporary_folder")
            profile, settings = arguments.pop("profile", None), arguments.pop("settings", None)
            assignments: Sequence[str] = arguments.pop("assignments", ())
            report = reporter(progress)
            cancellation.install(report.cancelled, watch_parent=watch_parent)
            say_of_formats(report)

            def work() -> RunResult:
                weights = values.get("weights")
                # names on PATH and of shipped weights are no files, which is left to those that look for them
                refuse_unusable([("pdal", pdal), ("weights", Path(weights) if weights else None)])
                if temporary is not None:
                    temporary_folders.choose(temporary)
                given = read_assignments(assignments, groups) | {n: v for n, v in values.items() if v is not None}
                used, chosen = _with_settings(settings, groups, values | given, profile, report)
                return function(Session(report, pdal, chosen, groups, used), **arguments)

            sys.exit(_run(report, debug, work, name=command_name(click.get_current_context())))

        wrapped: Command = run
        for group in reversed(groups):
            for specification in reversed(group.specifications()):
                wrapped = _option(specification, group.title)(wrapped)
        for shared in (*((_SET, *_SETTINGS[: 1 + profile]) if groups else ()), *_RUNNING):
            wrapped = shared(wrapped)
        return wrapped

    return decorate


def _run(report: Reporter, debug: bool, work: Callable[[], RunResult], name: str = "") -> int:
    error: SlopeWatchError
    try:
        with report:
            done = work()
        missing = [path for path in done.outputs.values() if not path.exists()]
        if missing:
            raise EngineError(f"{missing[0]} was promised but does not exist")
        with contextlib.suppress(BrokenPipeError):  # as by `| head`: everything is written, and the reader has enough
            report.result(done, conclusion(name, done))
        _flush_or_drop()
        return done.exit_code
    except SlopeWatchError as known:
        error = known
    except ParameterError as wrong:
        error = InputError(f"{wrong}.")
    except BrokenPipeError:
        error = EngineError(
            "The reader of the progress, or a program that this run had started, ended early; nothing was written."
        )
    except OSError as failed:
        error = _about_files(failed, debug)
    except MemoryError:
        error = EngineError("Memory ran out; clip the cloud to the slope or use a larger cell.")
    except Exception as unexpected:  # the last resort: an internal failure in one sentence
        error = _internal(unexpected, debug)
    with contextlib.suppress(BrokenPipeError):
        report.error(error)
    _flush_or_drop()
    return error.exit_code


def _about_files(failed: OSError, debug: bool) -> SlopeWatchError:
    """What the system says of a file or folder of the user's is no failure of the program."""
    name = os.fsdecode(failed.filename) if isinstance(failed.filename, (str, bytes)) else ""
    if failed.errno not in _OF_FILES or not name or Path(name).is_relative_to(Path(__file__).parents[1]):
        return _internal(failed, debug)
    if debug:
        traceback.print_exc()
    return InputError(
        f"{shown(name[:_SHOWN])} cannot be used ({failed.strerror}); check its path, permissions and the space left."
    )


def _internal(unexpected: Exception, debug: bool) -> EngineError:
    if debug:
        traceback.print_exc()
    place = traceback.extract_tb(unexpected.__traceback__)[-1]
    return EngineError(
        f"Internal failure: {type(unexpected).__name__}: {unexpected} "
        f"({Path(place.filename).name}, line {place.lineno}); run again with --debug for details."
    )


def _flush_or_drop() -> None:
    """Write out what standard output holds; where nobody reads it any more, drop it, so that the exit is silent."""
    try:
        sys.stdout.flush()
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
