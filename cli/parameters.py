"""``slopewatch parameters``: all that can be set of a command."""

from __future__ import annotations

import click

from .help_pages import write_every_option


@click.command()
@click.argument("command", nargs=-1, required=True, metavar="COMMAND")
@click.pass_context
def parameters(ctx: click.Context, command: tuple[str, ...]) -> None:
    """List all parameters of COMMAND with their defaults, bounds and meaning.

    Each is an option of the command. It can also be given by --set NAME=VALUE, or in a file by --settings.
    """
    program = ctx.parent
    assert program is not None
    found: click.Command = program.command
    inner = program
    for word in command:
        chosen = found.commands.get(word) if isinstance(found, click.Group) else None
        if chosen is None:
            raise click.UsageError(f"No such command '{' '.join(command)}'.", ctx)
        found, inner = chosen, click.Context(chosen, info_name=word, parent=inner)
    if isinstance(found, click.Group):
        raise click.UsageError(f"Give one of its commands, too: {', '.join(found.commands)}.", ctx)
    formatter = ctx.make_formatter()
    write_every_option(found, inner, formatter)
    click.echo(formatter.getvalue().rstrip())
