"""What the menu of the plugin offers: all tools of the toolbox by their groups."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

from qgis.core import QgsProcessingProvider
from qgis.PyQt.QtGui import QIcon
from qgis.PyQt.QtWidgets import QMenu, QWidget

from ..processing_algorithms import ALGORITHMS

try:  # QAction moved between Qt 5 and Qt 6
    from qgis.PyQt.QtGui import QAction
except ImportError:
    from qgis.PyQt.QtWidgets import QAction


def action(text: str, image: QIcon, slot: Callable[[], Any], parent: QWidget) -> QAction:
    """An entry of a menu."""
    made = QAction(image, text, parent)
    made.triggered.connect(lambda *_: slot())
    return made


def tool_menus(provider: QgsProcessingProvider, start: Callable[[str], None], parent: QWidget) -> list[QMenu]:
    """A menu for each group of the toolbox, in the order in which the tools are used; ``start`` opens one by its id."""
    menus: dict[str, QMenu] = {}
    names = dict.fromkeys([*(made.NAME for made in ALGORITHMS), *(a.name() for a in provider.algorithms())])
    for algorithm in (provider.algorithm(name) for name in names):  # models come last
        if algorithm.group() not in menus:
            menus[algorithm.group()] = QMenu(algorithm.group(), parent)
        identity = algorithm.id()
        entry = action(f"{algorithm.displayName()}…", algorithm.icon(), partial(start, identity), parent)
        entry.setObjectName(identity)
        entry.setToolTip(algorithm.shortDescription())
        menus[algorithm.group()].addAction(entry)
    return list(menus.values())
