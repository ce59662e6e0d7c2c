"""The words of a loaded layer's style in the language of QGIS: legend, names of the columns, choices of its form.

The engine writes styles in English, because the files go from hand to hand; values stay as they are in the table.
"""

from __future__ import annotations

from typing import Any

from qgis.core import (
    QgsCategorizedSymbolRenderer,
    QgsColorRampShader,
    QgsEditorWidgetSetup,
    QgsPalettedRasterRenderer,
    QgsRasterLayer,
    QgsVectorLayer,
)

from .words import tr

_CHOICES = "ValueMap"
_LAST_WORDS = ("raised", "lowered")
"""Of labels that have but a figure before it."""


def translate_style(layer: Any) -> None:
    """Have ``layer`` show what its style says in the language of QGIS; in English nothing changes."""
    if isinstance(layer, QgsVectorLayer):
        _translate_columns(layer)
        _translate_categories(layer.renderer())
    elif isinstance(layer, QgsRasterLayer):
        _translate_ramp(layer.renderer())


def _translate_columns(layer: QgsVectorLayer) -> None:
    for index, field in enumerate(layer.fields()):
        if field.alias():
            layer.setFieldAlias(index, tr(field.alias()))
        widget = layer.editorWidgetSetup(index)
        choices = widget.config().get("map") if widget.type() == _CHOICES else None
        if isinstance(choices, list):
            shown = [{tr(label): value for label, value in choice.items()} for choice in choices]
            layer.setEditorWidgetSetup(index, QgsEditorWidgetSetup(_CHOICES, {**widget.config(), "map": shown}))


def _translate_categories(renderer: Any) -> None:
    if isinstance(renderer, QgsCategorizedSymbolRenderer):
        for number, category in enumerate(renderer.categories()):
            renderer.updateCategoryLabel(number, _label(category.label()))


def _translate_ramp(renderer: Any) -> None:
    if isinstance(renderer, QgsPalettedRasterRenderer):
        for one in renderer.classes():
            renderer.setLabel(one.value, _label(one.label))
    shader = renderer.shader() if hasattr(renderer, "shader") else None
    ramp = shader.rasterShaderFunction() if shader is not None else None
    if isinstance(ramp, QgsColorRampShader):
        items = ramp.colorRampItemList()
        for item in items:
            item.label = _label(item.label)
        ramp.setColorRampItemList(items)


def _label(text: str) -> str:
    before, _, last = text.rpartition(" ")
    if before and last in _LAST_WORDS:
        return f"{before} {tr(last)}"
    parts = text.split(", ")
    words = [tr(part) for part in parts]
    if all(word != part for word, part in zip(words, parts)):
        return "，".join(words)
    return tr(text)
