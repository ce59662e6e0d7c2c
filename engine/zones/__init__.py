"""Significant cells to polygons, volumes and profiles."""
