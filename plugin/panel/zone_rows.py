"""The zones of a layer as the panel lists them."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

from qgis.core import QgsFeature, QgsMapLayer, QgsProject, QgsVectorLayer

from ...interface.alert_states import AlertState, alert_state
from ...interface.reviews import PHOTO, REMARKS, REVIEWER, STATES, STATUS, UNREVIEWED

# In layers of a change, of a series, and of a screening; the first that a layer has.
_SEVERITIES = ("severity", "alert", "confidence")
_CHANGES = ("dz_mean_m", "height_med_m")
_ALERT = ("alert_level", "alert", "alert_state", "alert_since", "alert_reason", "action")
_NEEDED = {"zone_id", "kind", "area_m2", STATUS}


@dataclass(frozen=True)
class ZoneRow:
    """A zone; ``change`` is its mean change, or the height that a screening found, in metres; ``area`` in m².

    ``alert`` is that of a zone of a series.
    """

    feature: int
    name: str
    date: str
    kind: str
    severity: str
    change: float | None
    area: float | None
    state: str
    reviewer: str
    remarks: str
    photo: str
    alert: AlertState | None = None


def is_zones_layer(layer: QgsMapLayer | None) -> bool:
    """Whether the layer holds zones of SlopeWatch that can be reviewed."""
    return isinstance(layer, QgsVectorLayer) and layer.isValid() and set(layer.fields().names()) >= _NEEDED


def zone_layers(project: QgsProject) -> list[QgsVectorLayer]:
    """The layers of zones in a project, in the order of their names."""
    found = [layer for layer in project.mapLayers().values() if is_zones_layer(layer)]
    return sorted(found, key=lambda layer: (layer.name(), layer.id()))


def zone_rows(layer: QgsVectorLayer) -> list[ZoneRow]:
    """All zones of a layer with what has been entered so far, saved or not."""
    return [_row(feature, set(layer.fields().names())) for feature in layer.getFeatures()]


def counts(rows: Iterable[ZoneRow]) -> dict[str, int]:
    """How many zones have each state."""
    states = [row.state for row in rows]
    return {state: states.count(state) for state in STATES}


def _row(feature: QgsFeature, names: set[str]) -> ZoneRow:
    def text(*fields: str) -> str:
        return next((_text(feature[name]) for name in fields if name in names), "")

    def number(*fields: str) -> float | None:
        return next((_number(feature[name]) for name in fields if name in names), None)

    return ZoneRow(
        feature=feature.id(),
        name=text("zone_id"),
        date=text("epoch_to"),
        kind=text("kind"),
        severity=text(*_SEVERITIES),
        change=number(*_CHANGES),
        area=number("area_m2"),
        state=text(STATUS) or UNREVIEWED,
        reviewer=text(REVIEWER),
        remarks=text(REMARKS),
        photo=text(PHOTO),
        alert=alert_state({name: _plain(feature[name]) for name in _ALERT if name in names}),
    )


def _text(value: Any) -> str:
    # what is NULL in the table is a QVariant, or None from QGIS 4 on
    return value if isinstance(value, str) else ""


def _plain(value: Any) -> Any:
    return value if isinstance(value, (str, int, float)) else None


def _number(value: Any) -> float | None:
    return float(value) if isinstance(value, (int, float)) else None
