"""The set-up as this QGIS orders it: its settings, its proxy, its Python; and the engine that is in use."""

from __future__ import annotations

import os
import sys
from pathlib import Path

from qgis.core import QgsApplication, QgsSettings

from ...interface.language import LANGUAGE_VARIABLE
from . import settings
from .interpreter import PLUGIN_FOLDER, VARIABLE, child_environment, find_interpreter, own_environments
from .language import language
from .resources import version
from .setup import places, pythons, requirements, state
from .setup.network import pip_environment, proxy_variables
from .setup.workshop import Order

QGIS_VARIABLE = "SLOPEWATCH_QGIS"
"""Names the folder that QGIS is installed in, for the engine to look for the PDAL that came with it."""
_PROXY = {
    "enabled": "proxy/proxyEnabled",
    "type": "proxy/proxyType",
    "host": "proxy/proxyHost",
    "port": "proxy/proxyPort",
    "user": "proxy/proxyUser",
    "password": "proxy/proxyPassword",
}


def data_folder() -> Path:
    """Where the set-up builds."""
    return places.data_folder(settings.get(settings.DATA_FOLDER))


def find_engine() -> tuple[Path, str]:
    """The engine's interpreter and how it was found.

    Raises:
        InterpreterNotFoundError: there is none; the message says how to get it.
    """
    return find_interpreter(settings.get(settings.ENGINE_PYTHON), data=data_folder())


def engine_environment() -> dict[str, str]:
    """The environment variables of the engine's process."""
    return {**child_environment(), QGIS_VARIABLE: QgsApplication.prefixPath(), LANGUAGE_VARIABLE: language()}


def condition() -> state.Condition:
    """Whether the engine stands for this plugin; one that is named or in the plugin's folder is taken as it is."""
    named = os.environ.get(VARIABLE, "") or settings.get(settings.ENGINE_PYTHON)
    if named or any(path.is_file() for path in own_environments(PLUGIN_FOLDER)):
        return state.Condition.READY
    return state.condition(data_folder(), requirements.ENGINE_LOCK, version())


def order(screening: bool, repair: bool, wheels: str = "", python: str = "") -> Order:
    """What to build here.

    Args:
        screening: with the network's packages. repair: anew, even if it stands. wheels: a folder of them, instead of
            the network. python: the Python to build from, instead of those that are found.
    """
    environ = child_environment()
    running = pythons.Running(sys.platform, sys.executable or "", sys.prefix, sys.version_info[:2])
    commands = pythons.candidates(running, os.environ, os.path.isfile)
    return Order(
        root=data_folder(),
        plugin=PLUGIN_FOLDER,
        version=version(),
        pythons=[((python,), "the parameter")] if python else commands,
        environ=environ,
        pip_environ=pip_environment(environ, qgis_proxy()),
        screening=screening,
        repair=repair,
        wheels=Path(wheels) if wheels else None,
    )


def qgis_proxy() -> dict[str, str]:
    """The proxy of Settings > Options > Network, as environment variables; none where QGIS uses none of its own."""
    stored = QgsSettings()
    found = {name: str(stored.value(key, "") or "") for name, key in _PROXY.items()}
    excluded = stored.value("proxy/noProxyUrls", []) or []
    found["noProxyUrls"] = "\n".join([excluded] if isinstance(excluded, str) else [str(one) for one in excluded])
    return proxy_variables(found)
