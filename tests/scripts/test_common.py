"""Versions and stamps: what decides whether a step of the set-up runs again."""

from __future__ import annotations

from pathlib import Path

import pytest


@pytest.mark.parametrize(
    ("have", "want", "enough"),
    [
        ("3.40.6", "3.34", True),
        ("3.34", "3.34", True),
        ("3.5", "3.34", False),
        ("3.22.16", "3.34", False),
        ("4.0", "3.34", True),
        ("2.2.0", "2.2", True),
        ("2.10", "2.9", True),
        ("3.08", "3.8", True),
        ("3", "3.0.1", False),
    ],
)
def test_versions_are_compared_part_by_part(shell, have, want, enough):
    assert (shell(f"version_at_least {have} {want}").returncode == 0) is enough


@pytest.mark.parametrize(
    ("text", "version"),
    [
        ("-----\npdal 2.2.0 (git-version: Release)\n", "2.2.0"),
        ("QGIS 3.40.6-Bratislava 'Bratislava' (exported)", "3.40.6"),
        ("1:3.40.6+dfsg-1~bpo12+1", "3.40.6"),
        ("no figures", ""),
    ],
)
def test_first_version_in_a_text(shell, text, version):
    result = shell(f"first_version <<'END'\n{text}\nEND\ntrue")
    assert result.stdout.strip() == version


def test_stamp_holds_only_for_the_same_inputs(shell, checkout: Path):
    lock = checkout / "lock"
    lock.write_text("numpy==1\n", encoding="utf-8")
    ask = 'is_stamped step "$(step_key python3.11 -- "$ROOT/lock")"'
    assert shell(ask).returncode != 0, "nothing was done yet"
    assert shell('stamp step "$(step_key python3.11 -- "$ROOT/lock")"').returncode == 0
    assert shell(ask).returncode == 0, "the second run has nothing to do"
    assert shell('is_stamped step "$(step_key python3.13 -- "$ROOT/lock")"').returncode != 0, "another interpreter"
    lock.write_text("numpy==2\n", encoding="utf-8")
    assert shell(ask).returncode != 0, "another lock"


def test_stamp_does_not_hold_for_a_moved_checkout(shell, checkout: Path):
    shell('stamp step "$(step_key words)"')
    moved = checkout.with_name("moved")
    checkout.rename(moved)
    assert shell('is_stamped step "$(step_key words)"', SLOPEWATCH_ROOT=str(moved)).returncode != 0


def test_a_failed_refresh_of_package_lists_does_not_stop_the_set_up(shell, checkout: Path):
    script = "as_root() { echo 'E: foreign source' >&2; return 100; }\napt_refresh\necho went on"
    result = shell(script)
    assert result.returncode == 0
    assert "did not answer" in result.stdout
    assert "went on" in result.stdout
    assert "foreign source" in (checkout / ".setup" / "apt.log").read_text(encoding="utf-8")


def test_a_failed_package_run_stops_it_and_shows_the_log(shell):
    script = "can_be_root() { :; }\nas_root() { [[ $* != *install* ]] || { echo 'E: no space left'; return 100; }; }\n"
    result = shell(script + "apt_install QGIS -t bookworm-backports qgis; echo not reached")
    assert result.returncode == 1
    assert "no space left" in result.stderr
    assert "QGIS: apt-get could not install" in result.stderr
    assert "not reached" not in result.stdout


def test_a_user_who_may_not_install_gets_one_sentence(shell):
    result = shell("can_be_root() { return 1; }\napt_install QGIS qgis xvfb; echo not reached")
    assert result.returncode == 1
    assert result.stdout == ""
    assert result.stderr.count("\n") == 1
    assert "apt-get install --no-install-recommends qgis xvfb" in result.stderr


def test_a_version_is_read_from_a_program_that_goes_on_talking(shell):
    result = shell('version=$({ echo pdal 2.8.1; sleep 0.2; seq 100000; } | first_version)\necho "found $version"')
    assert result.returncode == 0
    assert result.stdout.strip() == "found 2.8.1"
