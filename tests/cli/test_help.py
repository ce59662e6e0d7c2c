"""The help: commands by what users do, options under headings in the workflow's order, examples that are understood."""

from __future__ import annotations

import re
import shlex
from collections.abc import Iterator

import click
import pytest
from click.testing import CliRunner
from slopewatch.cli.examples import EXAMPLES
from slopewatch.cli.help_pages import FILES, PARAMETERS, RUNNING
from slopewatch.cli.program import cli
from slopewatch.interface.command_list import BASIC, COMMANDS, OTHERS
from slopewatch.interface.parameters import ParameterError, command_sets
from slopewatch.interface.settings_file import read_assignments

_HEADING = re.compile(r"^(\w[\w ,]+):$", re.MULTILINE)


def commands(group: click.Group = cli, before: str = "") -> Iterator[tuple[str, click.Command]]:
    for name, command in group.commands.items():
        if isinstance(command, click.Group):
            yield from commands(command, f"{before}{name} ")
        else:
            yield f"{before}{name}", command


EVERY = dict(commands())


def every(*words: str) -> str:
    """The list of all parameters of a command."""
    done = CliRunner().invoke(cli, ["parameters", *words])
    assert done.exit_code == 0
    return done.output


def page(*words: str) -> str:
    done = CliRunner().invoke(cli, [*words, "--help"])
    assert done.exit_code == 0
    return done.output


@pytest.mark.parametrize("name", EVERY)
def test_options_stand_under_headings_in_the_workflows_order(name: str) -> None:
    titles = list(dict.fromkeys(group.title for group in _groups(name)))
    headings = _HEADING.findall(every(*name.split()))
    files = [FILES] if FILES in headings else []
    assert headings == [*files, *titles, RUNNING]


@pytest.mark.parametrize("name", EVERY)
def test_help_is_short_and_says_where_the_rest_is(name: str) -> None:
    shown = page(*name.split())
    parts = dict(zip(_HEADING.findall(shown), _HEADING.split(shown)[2::2], strict=True))
    options = re.findall(r"^  --(?:no-)?([\w-]+)", parts.get(PARAMETERS, ""), re.MULTILINE)
    assert len(options) <= 15
    own = [s.option for group in _groups(name) for s in group.specifications()]
    assert set(options) <= set(own)
    left = len(set(own)) - len(options)
    assert (f"{left} more parameters: slopewatch parameters {name}" in shown) is (left > 0)
    assert len(shown.splitlines()) <= 75


@pytest.mark.parametrize("name", BASIC)
def test_basic_parameters_are_those_of_the_command(name: str) -> None:
    assert len(BASIC[name]) <= 15
    assert set(BASIC[name]) <= {s.name for group in _groups(name) for s in group.specifications()}


def test_a_command_that_is_not_there_has_no_parameters() -> None:
    for words, said in ((("nothing",), "No such command"), (("simulate",), "survey, series, scenes")):
        done = CliRunner().invoke(cli, ["parameters", *words])
        assert (done.exit_code, said in done.output) == (2, True)


def test_parameters_are_set_by_name_or_by_group_and_name() -> None:
    groups = command_sets.CHANGE
    texts = [
        "cell=0.2",
        "change.confidence = 0.9",
        "zones.minimum-area=2",
        "calibrate=no",
        "cell=auto",
        "memory_limit=2",
    ]
    found = read_assignments(texts, groups)
    assert found == {"cell": "auto", "confidence": 0.9, "minimum_area": 2.0, "calibrate": False, "memory_limit": 2.0}
    for text, said in (
        ("cel=1", "it may mean cell"),
        ("cell", "it may mean cell"),
        ("zones.cell=1", "it may mean cell"),
        ("what=1", "NAME=VALUE"),
        ("cell=wide", "give a number"),
        ("calibrate=perhaps", "true or false"),
        ("overwrite=yes", "names no parameter"),
    ):
        with pytest.raises(ParameterError, match=said):
            read_assignments([text], groups)


def _groups(name: str) -> command_sets.Sets:
    own: command_sets.Sets = getattr(command_sets, name.upper().replace(" ", "_"), ())
    return (*own, *command_sets.SERIES[-1:]) if name == "m3c2" else own or command_sets.GROUND[:1] * (name == "info")


def test_every_option_stands_under_the_heading_of_its_set() -> None:
    shown = every("inspect")
    parts = dict(zip(_HEADING.findall(shown), _HEADING.split(shown)[2::2], strict=True))
    for group in command_sets.INSPECT:
        for specification in group.specifications():
            assert f"--{specification.option} " in parts[group.title], specification.name
    assert "--output-dir" in parts[FILES]
    assert "--settings" in parts[RUNNING]


@pytest.mark.parametrize("name", EVERY)
def test_every_command_has_examples_that_it_understands(name: str) -> None:
    examples = EXAMPLES.get(name, ())
    assert 2 <= len(examples) <= 3, f"{name} has no examples: give it two or three in cli/examples.py"
    shown = page(*name.split())
    for words, line in examples:
        assert line.splitlines()[0] in shown
        assert words[0].isupper()
        program, *arguments = shlex.split(line.replace("\\\n", " "))
        assert program == "slopewatch"
        assert arguments[: len(name.split())] == name.split()
        EVERY[name].make_context(name, arguments[len(name.split()) :])  # raises where it is not understood
    assert not set(EXAMPLES) - set(EVERY)


def test_commands_stand_by_what_users_do_and_whole_sentences_describe_them() -> None:
    shown = page()
    headings = _HEADING.findall(shown)
    assert headings == ["Options", *(heading for heading in COMMANDS if heading in headings)]
    assert OTHERS not in headings, "a command is not listed in interface/command_list.py"
    for name in cli.commands:
        assert len(re.findall(rf"^  {name} ", shown, re.MULTILINE)) == 1
    assert "..." not in shown.partition("Options:")[2]


def test_a_command_that_nobody_listed_is_shown_all_the_same() -> None:
    program = type(cli)("program")
    program.add_command(click.Command("inspect", help="One."))
    program.add_command(click.Command("unheard", help="Two."))
    shown = CliRunner().invoke(program, ["--help"]).output
    assert _HEADING.findall(shown) == ["Options", "Inspect slopes", OTHERS]
    assert "unheard  Two" in shown
