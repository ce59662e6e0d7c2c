"""Hooks of the site (mkdocs.yml): links that leave docs/, and the page of commands."""

from __future__ import annotations

import posixpath
import re
from collections.abc import Iterator
from typing import Any

import click
from slopewatch.cli.program import cli
from slopewatch.interface.command_list import COMMANDS, TITLES

REPOSITORY = "https://github.com/slopewatch/slopewatch/blob/main/"
MARK = "<!-- commands -->"


def on_page_markdown(markdown: str, page: Any, **_: Any) -> str:
    """The page as the site shows it."""
    markdown = re.sub(r"\]\(((?:\.\./)+[^)]+)\)", lambda link: f"]({outside(link[1], page.file.src_uri)})", markdown)
    return markdown.replace(MARK, "\n".join(described())) if MARK in markdown else markdown


def outside(target: str, page: str) -> str:
    """A link of a page in docs/; one that leaves docs/ leads into the repository."""
    path = posixpath.normpath(posixpath.join("docs", posixpath.dirname(page), target))
    return target if path.startswith("docs/") else REPOSITORY + path


def described() -> Iterator[str]:
    """Every command with its options, as its own help has them."""
    for heading, names in COMMANDS.items():
        yield f"## {heading}\n"
        for name in names:
            command = cli.commands[name]
            parts = command.commands if isinstance(command, click.Group) else {}
            for part in parts or (None,):
                yield from one(f"{name} {part}" if part else name, parts[part] if part else command)


def one(name: str, command: click.Command) -> Iterator[str]:
    """One command."""
    yield f"### slopewatch {name}\n"
    title = f"*{TITLES[name]}* in QGIS. " if name in TITLES else ""
    yield f"{title}{' '.join((command.help or '').split())}\n"
    yield "| option | what it does |\n|---|---|"
    for parameter in command.params:
        if isinstance(parameter, click.Option) and not parameter.hidden:
            words = " ".join((parameter.help or "").split()).replace("|", "\\|").replace("<", "&lt;")
            yield f"| `{', '.join(parameter.opts)}` | {words} |"
    yield ""
