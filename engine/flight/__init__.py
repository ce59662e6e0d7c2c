"""Flights over a slope: lines, waypoints, and what a survey along them is expected to show."""
