"""The pages of ``--help``: options under headings in the workflow's order, examples, commands by what users do."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable
from typing import Any

import click

from ..interface.command_list import BASIC, COMMANDS, OTHERS
from .examples import EXAMPLES
from .language import paragraphs, say

FILES = "Files"
"""Heading of a command's own options, which are mostly files and folders; they come first."""
PARAMETERS = "Parameters"
"""Heading of those parameters that most people set."""
RUNNING = "Running"
"""Heading of the options that all commands have; they come last."""


class _GroupedOption(click.Option):
    """An option with the heading under which help shows it; an ``advanced`` one is only in the list of all."""

    heading, advanced = FILES, False


def grouped_option(
    heading: str, *names: str, advanced: bool = False, **given: Any
) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """``click.option`` under a heading; an empty one stands for that of the command's own options."""
    kind = type("_Option", (_GroupedOption,), {"heading": heading or FILES, "advanced": advanced})
    return click.option(*names, cls=kind, **given)


def records_of(command: click.Command, ctx: click.Context) -> dict[str, list[tuple[click.Parameter, tuple[str, str]]]]:
    """All options of a command with what help says of them, by heading, those of all commands last."""
    records: dict[str, list[tuple[click.Parameter, tuple[str, str]]]] = {FILES: []}
    for parameter in command.get_params(ctx):
        record = parameter.get_help_record(ctx)
        if record is not None and record[1]:  # arguments without a help stand in the first line
            shared = RUNNING if "--help" in parameter.opts else FILES
            records.setdefault(getattr(parameter, "heading", shared), []).append((parameter, record))
    return {heading: found for heading, found in records.items() if heading != RUNNING} | {RUNNING: records[RUNNING]}


class GroupedCommand(click.Command):
    """A command whose help has headings and examples, in the language of the user."""

    def format_help_text(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        _write_paragraphs(formatter, self.help or "")

    def format_options(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        name = command_name(ctx)
        basic, left = BASIC.get(name), 0
        shown: dict[str, list[tuple[str, str]]] = {FILES: [], PARAMETERS: [], RUNNING: []}
        for heading, found in records_of(self, ctx).items():
            place = heading if heading in shown else PARAMETERS
            for parameter, (names, text) in found:
                advanced = getattr(parameter, "advanced", False)
                if place == PARAMETERS and basic is not None:
                    advanced = parameter.name not in basic
                if not advanced:
                    shown[place].append((names, _in_short(say(text))))
                elif place == PARAMETERS:
                    left += 1
        _write_lists(formatter, shown.items(), said=True)
        if left:
            formatter.write_paragraph()
            formatter.write_text(f"{say(f'{left} more parameters:')} slopewatch parameters {name}")

    def format_epilog(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        examples = EXAMPLES.get(command_name(ctx), ())
        if examples:
            with formatter.section(say("Examples")):
                for words, line in examples:
                    formatter.write_text(f"{say(words)}:")
                    formatter.indent()
                    formatter.write(_lines(line, formatter.current_indent))
                    formatter.dedent()
        super().format_epilog(ctx, formatter)


class Program(click.Group):
    """The program: its commands by what users do; each command gets headings and examples."""

    def format_help_text(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        _write_paragraphs(formatter, self.help or "")

    def format_options(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        _write_options(self, ctx, formatter)

    def add_command(self, cmd: click.Command, name: str | None = None) -> None:
        grouped(cmd)
        super().add_command(cmd, name)

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        left = dict.fromkeys(self.list_commands(ctx))
        for heading, names in COMMANDS.items():
            _write_lists(formatter, [(heading, self._rows(names, left, formatter))])
        _write_lists(formatter, [(OTHERS, self._rows(tuple(left), left, formatter))])

    def _rows(
        self, names: Iterable[str], left: dict[str, None], formatter: click.HelpFormatter
    ) -> list[tuple[str, str]]:
        """Name and first sentence of those commands that there are and that have not been shown."""
        shown = [name for name in names if name in left]
        for name in shown:
            del left[name]
        return [(name, _first_sentence(self.commands[name].help or "")) for name in shown]


class InnerGroup(click.Group):
    """Commands under one name, such as ``simulate``."""

    def format_help_text(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        _write_paragraphs(formatter, self.help or "")

    def format_options(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        _write_options(self, ctx, formatter)

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        rows = [(name, _first_sentence(self.commands[name].help or "")) for name in self.list_commands(ctx)]
        _write_lists(formatter, [("Commands", rows)])


def _write_options(group: click.Group, ctx: click.Context, formatter: click.HelpFormatter) -> None:
    """The options of a group, then its commands, as click has them, in the language of the user."""
    records = [record for parameter in group.get_params(ctx) if (record := parameter.get_help_record(ctx))]
    _write_lists(formatter, [("Options", records)])
    group.format_commands(ctx, formatter)


def grouped(cmd: click.Command) -> None:
    """Give a command, and those of a group, the help of ``GroupedCommand``, however it was declared."""
    if isinstance(cmd, click.Group):
        for inner in cmd.commands.values():
            grouped(inner)
        if type(cmd) is click.Group:
            cmd.__class__ = InnerGroup
    elif type(cmd) is click.Command:
        cmd.__class__ = GroupedCommand  # which only overrides what is written as help


def _write_paragraphs(formatter: click.HelpFormatter, text: str) -> None:
    for paragraph in paragraphs(text):
        formatter.write_paragraph()
        with formatter.indentation():
            formatter.write_text(paragraph)


def _first_sentence(text: str) -> str:
    """Of a command's description, without its full stop."""
    first = next(iter(paragraphs(text)), "")
    return re.split(r"(?<=[.])\s|(?<=。)", first)[0].rstrip(".。")


def _in_short(text: str) -> str:
    """The first clause of a text and its default."""
    words, bracket = re.fullmatch(r"(.*?)(\s*\[[^\[]*\])?", text, flags=re.DOTALL).groups()  # type: ignore[union-attr]
    return re.split(r"(?<=[.])\s|(?<=。)|[;；]", words)[0] + (bracket or "")


def _write_lists(
    formatter: click.HelpFormatter, lists: Iterable[tuple[str, list[tuple[str, str]]]], *, said: bool = False
) -> None:
    """Lists under headings; texts that are ``said`` are in the user's language already."""
    for heading, rows in lists:
        if rows:
            with formatter.section(say(heading)):
                formatter.write_dl([(names, text if said else say(text)) for names, text in rows])


def write_every_option(command: click.Command, ctx: click.Context, formatter: click.HelpFormatter) -> None:
    """All options of a command, in the workflow's order."""
    found = records_of(command, ctx)
    _write_lists(formatter, [(heading, [record for _, record in rows]) for heading, rows in found.items()])


def command_name(ctx: click.Context) -> str:
    """The command as it is called after the program's name: ``simulate survey``."""
    names = []
    while ctx.parent is not None:
        names.append(str(ctx.info_name))
        ctx = ctx.parent
    return " ".join(reversed(names))


def _lines(command: str, indent: int) -> str:
    """A command as it is typed, on several lines where it has line breaks."""
    space = " " * indent
    return "".join(f"{space}{line}\n" for line in command.splitlines())
