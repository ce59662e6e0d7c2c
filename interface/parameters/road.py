"""Parameters of places along a road."""

from __future__ import annotations

from dataclasses import dataclass

from .specification import ParameterSet, _parameter


@dataclass(frozen=True)
class RoadParameters(ParameterSet, record_name="road", title="Road"):
    """Chainages along a centreline."""

    centreline_layer: str = _parameter(
        "",
        "Layer of the centreline",
        "Name of the layer of lines in the centreline's file. Empty: its first layer of lines.",
        advanced=True,
    )
    route_name: str = _parameter(
        "",
        "Name of the route",
        "The road's name where the centreline has no field route, or an empty one.",
        advanced=True,
    )
    chainage_start: float = _parameter(
        0.0,
        "Chainage at the start of the centreline",
        "Added to the distance along the centreline, where the centreline has no chainages of its own.",
        unit="m",
        bounds=(-1e7, 1e7),
        advanced=True,
    )
    chainage_direction: str = _parameter(
        "drawn",
        "Direction of growing chainage",
        "drawn: chainage grows in the direction in which the lines were drawn; reversed: against it. Lines with "
        "chainages of both ends say it themselves.",
        choices=("drawn", "reversed"),
        advanced=True,
    )
    chainage_unit: str = _parameter(
        "m",
        "Unit of the centreline's chainages",
        "Of the numbers in the fields chain_from and chain_to: m, km, ft (international feet) or us_ft (US survey "
        "feet). Zones get metres whatever it is.",
        choices=("m", "km", "ft", "us_ft"),
        advanced=True,
    )
    chainage_equations: bool = _parameter(
        False,
        "Chainage may jump",
        "On: a jump of the chainage where two lines join is an equation of chainage, which is followed and reported. "
        "Off: it is refused as a gap.",
        advanced=True,
    )
    chainage_style: str = _parameter(
        "K12+345",
        "How chainages are written",
        "In the field location, reports and labels: K12+345 or 12+345 for kilometres and metres, km, m, or stations of "
        "100 feet.",
        choices=("K12+345", "12+345", "km", "m", "stations"),
        advanced=True,
    )
    road_reach: float = _parameter(
        200.0,
        "Reach of a road",
        "A zone farther than this from every centreline is not placed, and a centreline farther from the slope is "
        "refused. Larger places zones on roads farther away.",
        unit="m",
        bounds=(0.1, 1e5),
        advanced=True,
    )
    road_tolerance: float = _parameter(
        1.0,
        "Roads are equally near within",
        "A zone whose distances to two roads differ by no more than this is placed on neither, and both are named. "
        "Larger leaves more zones without a place.",
        unit="m",
        bounds=(0.0, 1e3),
        advanced=True,
    )
