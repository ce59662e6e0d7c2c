"""The plugin in QGIS's profiles: linked and switched on, a user's own copy left alone."""

from __future__ import annotations

from pathlib import Path

import pytest


@pytest.fixture
def qgis(tmp_path: Path) -> str:
    """Bash that stands for an installed QGIS 3.40 whose qgis_process switches plugins on in the profile it is given."""
    program = tmp_path / "bin" / "qgis_process"
    program.parent.mkdir()
    program.write_text(
        """#!/bin/sh
profiles=$QGIS_CUSTOM_CONFIG_PATH/profiles
profile=$profiles/$(sed -n 's/^defaultProfile=//p' "$profiles/profiles.ini" 2>/dev/null || true)
[ -e "$profile" ] && [ "$profile" != "$profiles/" ] || profile=$profiles/default
[ "$1 $2" = "plugins enable" ] && [ -e "$profile/python/plugins/$3/metadata.txt" ] || exit 1
mkdir -p "$profile/QGIS"
printf '[PythonPlugins]\\n%s=true\\n' "$3" >"$profile/QGIS/QGIS3.ini"
""",
        encoding="utf-8",
    )
    program.chmod(0o755)
    return f"export PATH={program.parent}:$PATH\nqgis_version() {{ echo 3.40.6; }}\n"


def user_plugins(tmp_path: Path, profile: str = "default") -> Path:
    return tmp_path / "home" / ".local/share/QGIS/QGIS3/profiles" / profile / "python/plugins"


def test_private_profile_is_linked_and_switched_on_once(shell, qgis, checkout):
    first = shell(qgis + "setup_profile")
    assert first.returncode == 0, first.stderr
    assert (checkout / ".qgis/profiles/default/python/plugins/slopewatch").resolve() == checkout.resolve()
    assert "slopewatch=true" in (checkout / ".qgis/profiles/default/QGIS/QGIS3.ini").read_text(encoding="utf-8")
    second = shell(qgis + "enable_plugin() { echo asked; return 1; }\nsetup_profile")
    assert second.returncode == 0
    assert "as before" in second.stdout


def test_a_plugin_that_is_switched_on_already_is_no_failure(shell, qgis, checkout):
    assert shell(qgis + "setup_profile").returncode == 0
    (checkout / "metadata.txt").write_text("[general]\nversion=2\n", encoding="utf-8")
    again = shell(qgis + "enable_plugin() { echo 'Plugin is already enabled!'; return 1; }\nsetup_profile")
    assert again.returncode == 0, again.stderr
    assert "as before" not in again.stdout


def test_a_plugin_that_qgis_cannot_switch_on_stops_the_set_up(shell, qgis, checkout):
    (checkout / "metadata.txt").write_text("", encoding="utf-8")
    result = shell(qgis + "enable_plugin() { echo 'no such plugin'; return 1; }\nsetup_profile")
    assert result.returncode == 1
    assert "no such plugin" in result.stderr
    assert not list((checkout / ".setup").glob("profile.stamp"))


def test_install_links_and_uninstall_takes_only_the_link_away(shell, qgis, checkout, tmp_path):
    result = shell(qgis + "install_plugin")
    place = user_plugins(tmp_path) / "slopewatch"
    assert result.returncode == 0, result.stderr
    assert place.is_symlink()
    assert place.resolve() == checkout.resolve()
    assert "switched on in profile default" in result.stdout
    result = shell(qgis + "uninstall_plugin")
    assert result.returncode == 0
    assert not place.is_symlink()
    assert (checkout / "metadata.txt").exists()


def test_install_takes_the_profile_that_qgis_starts_with(shell, qgis, tmp_path):
    profiles = user_plugins(tmp_path, "work").parents[2]
    (profiles / "work").mkdir(parents=True)
    (profiles / "profiles.ini").write_text("[core]\ndefaultProfile=work\n", encoding="utf-8")
    result = shell(qgis + "install_plugin")
    assert (user_plugins(tmp_path, "work") / "slopewatch").is_symlink(), result.stdout + result.stderr
    assert "switched on in profile work" in result.stdout


@pytest.mark.parametrize("command", ["install_plugin", "uninstall_plugin"])
def test_a_copy_of_the_plugin_manager_is_left_alone(shell, qgis, tmp_path, command):
    place = user_plugins(tmp_path) / "slopewatch"
    place.mkdir(parents=True)
    (place / "metadata.txt").touch()
    result = shell(qgis + command)
    assert result.returncode == 1
    assert "plugin manager" in result.stderr
    assert not place.is_symlink()
    assert (place / "metadata.txt").exists()
