"""The terminal in another language: help, errors and events, and what stays English."""

from __future__ import annotations

import json
import re

import pytest
from click.testing import CliRunner
from slopewatch.cli.program import cli
from slopewatch.cli.reporting import JsonReporter
from slopewatch.engine.core.run_result import RunResult
from slopewatch.tests.builders.program import run

LATIN = re.compile(r"[A-Za-z]{3,}")


def test_an_error_is_one_chinese_sentence_with_the_name_as_it_is(tmp_path):
    missing = tmp_path / "missing.laz"
    done = run("info", missing, "--language", "zh_CN")
    assert done.returncode == 2
    said = done.stderr.strip()
    assert said.startswith("错误：")
    assert str(missing) in said
    assert LATIN.findall(said.replace(str(missing), "")) == []


def test_events_for_qgis_are_in_the_language(tmp_path):
    done = run("info", tmp_path / "missing.laz", "--progress", "json", "--language=zh_CN")
    assert done.returncode == 2
    event = json.loads(done.stdout.splitlines()[-1])
    assert (event["event"], event["code"]) == ("error", 2)
    assert "请" in event["message"]


def test_what_the_command_line_itself_refuses_is_chinese():
    done = run("register", "--language", "zh_CN")
    assert done.returncode == 2
    assert "缺少参数'REFERENCE'" in done.stderr


@pytest.mark.parametrize("command", [*cli.commands])
def test_help_is_chinese_but_for_names(monkeypatch, command):
    """What is left of Latin letters are options, values, units, formats and file names."""
    monkeypatch.setenv("SLOPEWATCH_LANGUAGE", "zh_CN")
    page = CliRunner().invoke(cli, [command, "--help"])
    assert page.exit_code == 0
    sentences = re.findall(r"(?:\b[a-z]+ ){4,}[a-z]+\b", page.stdout)
    assert sentences == []
    assert re.search(r"[\u4e00-\u9fff]", page.stdout)


@pytest.mark.parametrize("command", [(), ("simulate",)])
def test_the_help_of_a_group_is_chinese(monkeypatch, command):
    monkeypatch.setenv("SLOPEWATCH_LANGUAGE", "zh_CN")
    page = CliRunner().invoke(cli, [*command, "--help"])
    assert page.exit_code == 0
    said = [line for line in page.stdout.splitlines() if line.strip() and not line.startswith("Usage:")]
    assert [line for line in said if not re.search(r"[\u4e00-\u9fff]", line)] == []


def test_figures_of_a_result_do_not_change(monkeypatch, capsys):
    monkeypatch.setenv("SLOPEWATCH_LANGUAGE", "zh_CN")
    JsonReporter().result(RunResult({}, {"zone_count": 3}), ["No zones"])
    event = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert event["metrics"] == {"zone_count": 3}
    assert event["conclusion"] == ["无变化区"]
