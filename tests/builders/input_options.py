"""Every option and argument of every command that takes a file, found in the commands themselves.

A new path is taken for an input, so it is tried with files of all bad kinds without a word here. A new text must be
named in ``FILE_TEXTS`` or ``WORDS``, a new output in ``OUTPUTS``, a new command in ``SOUND``.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import click
from slopewatch.cli.program import cli


def _commands() -> Iterator[tuple[str, click.Command]]:
    for name, program in cli.commands.items():
        if isinstance(program, click.Group):
            yield from ((f"{name} {inner}", below) for inner, below in program.commands.items())
        else:
            yield name, program


COMMANDS = dict(_commands())
OUTPUTS = {
    *((command, name) for command in COMMANDS for name in ("output_dir", "output", "temporary_folder")),
    ("register", "transform"), *(("screen", name) for name in ("zones", "raster", "smallest_hazard", "map_path")),
}  # fmt: skip
"""Paths that are written."""
FILE_TEXTS = {
    "epochs": "2024-05-01={}", "models": "2024-05-01={}", "season": "2024-05-01={}", "weights": "{}", "start": "{}",
    "scheduler": "{}",
}  # fmt: skip
"""Texts that name a file, and how."""
WORDS = {
    "actions", "assignments", "author", "velocities", "centreline_layer", "chainage_range", "checker", "class_field",
    "client", "command", "crs",
    "dashboard_address", "email", "epoch_from", "epoch_to", "flight_dates", "flying_height", "formats", "label_field",
    "labels", "layer", "licence", "metadata_title", "organisation", "orientation", "picture_address", "profile_field",
    "project_title", "report_remarks", "report_route", "route_name", "schema", "sensor", "slope_name",
    "takeoff_ellipsoid_height", "takeoff_height", "address", "uav", "weather", "dimension", "classes",
}  # fmt: skip
"""Texts that name no file."""
FOLDERS = {("series", "source"), ("batch", "manifest"), ("report", "folder"), ("report", "photos"),
           ("exportgis", "run"), ("createproject", "run")}  # fmt: skip
"""Inputs that may be a folder."""

_PAIR = {"reference": "cloud", "moving": "later"}
SOUND: dict[str, dict[str, str]] = {
    "inspect": {"epochs": "cloud,later", "roi": "area", "output_dir": "out"},
    "ground": {"cloud": "cloud", "output": "out.laz"},
    "register": {**_PAIR, "output": "out.laz"},
    "change": {**_PAIR, "output_dir": "out", "epoch_from": "=2024-05-01", "epoch_to": "=2025-05-01"},
    "demchange": {"models": "model,later_model", "output_dir": "out"},
    "m3c2": {**_PAIR, "output": "out.laz"},
    "displacement": {**_PAIR, "output_dir": "out", "epoch_from": "=2024-05-01", "epoch_to": "=2025-05-01"},
    "locate": {"source": "area", "centreline": "line", "output": "out.gpkg"},
    "screen": {"cloud": "cloud", "output": "out.laz"},
    "series": {"epochs": "cloud,later", "output_dir": "out"},
    "batch": {"manifest": "manifest", "output_dir": "out"},
    "report": {"folder": "run"},
    "exportgis": {"run": "run", "output": "out.zip"},
    "createproject": {"run": "run", "output": "out.qgz"},
    "topview": {"cloud": "cloud", "output_dir": "out"},
    "suggestroi": {"cloud": "cloud", "output": "out.gpkg"},
    "exportlabelstudio": {"picture": "picture", "output_dir": "out"},
    "importlabelstudio": {"export": "labels", "tasks": "tasks", "output": "out.gpkg"},
    "info": {"cloud": "cloud"},
    "planflight": {"terrain": "cloud", "roi": "area", "output_dir": "out"},
    "compareflight": {"plan": "plan", "cloud": "cloud", "output_dir": "out"},
    "train": {"clouds": "cloud", "polygons": "area", "output_dir": "out"},
    **{f"simulate {name}": {"output_dir": "out"} for name in ("survey", "series", "scenes")},
    "check": {},
    "parameters": {},
}
"""What each command needs besides the option that is tried: parameter and kind of file; after = it is a text."""
_WITH = {"field_names": {"centreline": "line"}}
"""What an option needs besides."""


@dataclass(frozen=True)
class FileOption:
    """A parameter of a command that takes a file."""

    command: str
    parameter: click.Parameter

    @property
    def name(self) -> str:
        return str(self.parameter.name)

    @property
    def ending(self) -> str:
        """Without which a text is taken for something else than a file."""
        return ".json" if self.name == "scheduler" else ""

    @property
    def takes_folders(self) -> bool:
        return (self.command, self.name) in FOLDERS

    def __str__(self) -> str:
        return f"{self.command} {self.parameter.opts[0]}"

    def arguments(self, bad: Path, files: Mapping[str, Path], out: Path) -> list[str]:
        """The command line with ``bad`` for this parameter and sound files for those that are needed."""
        given = {**SOUND[self.command], **_WITH.get(self.name, {})}
        if self.name == "source" and self.command == "series":
            given.pop("epochs")  # instead of which it is given
        values = {name: _values(name, kinds, files, out) for name, kinds in given.items()}
        text = FILE_TEXTS.get(self.name, "{}").format(bad)
        values[self.name] = [text, *values.get(self.name, [])[1:]]
        words: list[str] = []
        for parameter in COMMANDS[self.command].params:
            for value in values.get(str(parameter.name), []):
                words += [value] if isinstance(parameter, click.Argument) else [parameter.opts[0], value]
        return [*self.command.split(), *words]


def _values(name: str, kinds: str, files: Mapping[str, Path], out: Path) -> list[str]:
    if kinds.startswith("="):
        return [kinds[1:]]
    if kinds.startswith("out"):
        return [str(out / kinds)]
    days = iter(("2024-05-01", "2025-05-01"))
    form = FILE_TEXTS.get(name, "{}")
    return [form.replace("2024-05-01", next(days)).format(files[kind]) for kind in kinds.split(",")]


def file_options() -> Iterator[FileOption]:
    """Every parameter that takes an existing file."""
    for command, program in COMMANDS.items():
        for parameter in program.params:
            path = isinstance(parameter.type, click.Path) and (command, parameter.name) not in OUTPUTS
            if path or (parameter.name in FILE_TEXTS and not isinstance(parameter.type, click.Path)):
                yield FileOption(command, parameter)


def unknown_texts() -> set[str]:
    """Parameters that take any text and are neither words nor files, as far as this file knows."""
    texts = {
        str(parameter.name)
        for program in COMMANDS.values()
        for parameter in program.params
        if isinstance(parameter.type, click.types.StringParamType)
    }
    return texts - WORDS - FILE_TEXTS.keys()
