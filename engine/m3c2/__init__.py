"""Distances along normals."""
