"""The fields, kinds and severities of hazard zones."""

from __future__ import annotations

# Name and kind of every field, in the order of the attribute table. Text is never NULL; a number that is not known is.
FIELDS: dict[str, str] = {
    "zone_id": "text",
    "slope_id": "text",
    "route": "text",
    "chain_from": "real",
    "chain_to": "real",
    "side": "text",
    "epoch_from": "text",
    "epoch_to": "text",
    "days": "integer",
    "kind": "text",
    "severity": "text",
    "confidence": "real",
    "dz_mean_m": "real",
    "dz_min_m": "real",
    "dz_max_m": "real",
    "dz_p95_m": "real",
    "area_m2": "real",
    "n_cells": "integer",
    "vol_loss_m3": "real",
    "vol_gain_m3": "real",
    "vol_net_m3": "real",
    "vol_err_m3": "real",
    "vol_low_m3": "real",
    "vol_high_m3": "real",
    "vol_area_m2": "real",
    "vol_measured": "real",
    "n_eff": "real",
    "lod95_m": "real",
    "rate_mm_day": "real",
    "rate_err": "real",
    "slope_deg": "real",
    "n_pts_min": "integer",
    "n_epochs_confirmed": "integer",
    "review_status": "text",
    "reviewer": "text",
    "remarks": "text",
    "method": "text",
    "run_id": "text",
}
UNSURE = "unsure"
"""In place of a severity, where noise alone may have made the zone."""
SEVERITIES = ("high", "moderate", "low", UNSURE)
KINDS = ("subsidence", "uplift")
