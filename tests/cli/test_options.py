"""Options made from the parameters, without starting a command."""

from __future__ import annotations

from typing import Any

import click
import pytest
from slopewatch.cli import options
from slopewatch.interface.parameters import AUTO, ChangeParameters, FineTuneParameters, ParameterSet


def parsed(group: type[ParameterSet], name: str, text: str) -> Any:
    specification = next(s for s in group.specifications() if s.name == name)
    program = click.command()(options._option(specification)(lambda **values: values))
    return program.main([f"--{specification.option}", text], standalone_mode=False)


@pytest.mark.parametrize(
    ("group", "name", "text", "value"),
    [
        (ChangeParameters, "cell", "auto", AUTO),
        (ChangeParameters, "cell", "0", AUTO),
        (ChangeParameters, "cell", "0.25", 0.25),
        (ChangeParameters, "registration_error", "auto", AUTO),
        (ChangeParameters, "registration_error", "-1", AUTO),
        (ChangeParameters, "registration_error", "0", 0.0),
        (FineTuneParameters, "threads", "auto", AUTO),
        (FineTuneParameters, "threads", "3", 3),
    ],
)
def test_a_number_may_be_left_to_the_data(group: type[ParameterSet], name: str, text: str, value: object) -> None:
    assert getattr(group.build(parsed(group, name, text)), name) == value


@pytest.mark.parametrize("text", ["wide", "2.5", ""])
def test_what_is_neither_number_nor_auto_is_refused(text: str) -> None:
    with pytest.raises(click.BadParameter, match="neither a number nor auto"):
        parsed(FineTuneParameters, "threads", text)
