"""Polygons and lines in, GeoPackage out."""
