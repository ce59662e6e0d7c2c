"""What people enter about a zone: names of the columns, and the states of a review."""

from __future__ import annotations

UNREVIEWED, CONFIRMED, REJECTED = "unreviewed", "confirmed", "rejected"
STATES = (UNREVIEWED, CONFIRMED, REJECTED)
STATUS, REVIEWER, REMARKS = "review_status", "reviewer", "remarks"
REVIEWED = "review_date"
"""A column that the panel adds with the first state that it enters: its day, such as 2025-05-01."""
PHOTO = "photo"
"""A column that the panel adds with the first picture: its path, which may count from the folder of the table."""
