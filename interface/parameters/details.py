"""Parameters of the report to sign."""

from __future__ import annotations

from dataclasses import dataclass

from .specification import ParameterSet, _parameter

_EACH = "One text for all surveys, or one for each, the earliest first, with semicolons between."


@dataclass(frozen=True)
class DetailParameters(ParameterSet, record_name="details", title="Report to sign"):
    """What a report to sign says of the slope, the people and the flights; what is empty is left to fill in by hand."""

    pdf: bool = _parameter(
        False,
        "PDF to sign",
        "Also writes the report as a PDF to print and sign: verdict, map, a sheet for each zone, thresholds and fields "
        "for signatures. Details that are not given are blank lines in it.",
    )
    slope_name: str = _parameter("", "Name of the slope", "Name or number of the slope in the register.", advanced=True)
    report_route: str = _parameter(
        "", "Route", "Road or railway line of the slope. Empty: that of its zones, where they have one.", advanced=True
    )
    chainage_range: str = _parameter(
        "",
        "Chainage",
        "Where the slope lies along the route, such as K12+340 to K12+460. Empty: that of its zones, where they have "
        "one.",
        advanced=True,
    )
    client: str = _parameter("", "Client", "For whom the report is.", advanced=True)
    author: str = _parameter("", "Author", "Who prepared the report, and will sign it.", advanced=True)
    checker: str = _parameter("", "Checker", "Who checks the report, and will sign it.", advanced=True)
    uav: str = _parameter("", "UAV", f"Aircraft of the flights. {_EACH}", advanced=True)
    sensor: str = _parameter("", "Sensor", f"Laser scanner of the flights. {_EACH}", advanced=True)
    flying_height: str = _parameter(
        "", "Flying height", f"Height over the ground, with its unit. {_EACH}", advanced=True
    )
    flight_dates: str = _parameter(
        "", "Dates of the flights", f"Where they are not the days of the surveys. {_EACH}", advanced=True
    )
    weather: str = _parameter(
        "", "Weather", f"Weather and state of the ground during the flights. {_EACH}", advanced=True
    )
    report_remarks: str = _parameter(
        "", "Remarks in the report", "Remarks of the author on the last page of the report.", advanced=True
    )
    actions: str = _parameter(
        "", "Actions", "What is recommended or decided, on the last page of the report.", advanced=True
    )
