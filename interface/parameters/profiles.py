"""Named sets of values by the parameter set's ``record_name``: the defaults, and the published workflow's settings."""

from __future__ import annotations

from typing import Any

PUBLISHED_WORKFLOW = (
    "A UAV-Based Multi-Modal Vision System for Automated Sideslope Deformation Monitoring and Hazard Detection (2026)"
)
PUBLISHED_WORKFLOW_ID = "arXiv:2606.20681"
"""Title and number of the work whose flow SlopeWatch follows and whose settings the profile ``paper`` has."""

PROFILES: dict[str, dict[str, dict[str, Any]]] = {
    "default": {},
    "paper": {
        "ground": {
            "slope_aligned": False,
            "cloth_resolution": 0.1,
            "rigidness": 1,
            "time_step": 0.5,
            "class_threshold": 0.05,
            "refine": False,
            "last_returns": False,
            "slope_smoothing": False,
        },
        "registration": {
            "method": "icp",
            "maximum_correspondence": 0.10,
            "registration_iterations": 200,
        },
        "change": {
            "cell": 0.1,
            "cell_value": "mean",
            "minimum_points": 1,
            "threshold": "probabilistic",
            "direction": "vertical",
            "calibrate": False,
            "adaptive": False,
        },
    },
}
