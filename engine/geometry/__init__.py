"""Planes, rigid motions, voxels. Knows no files."""
