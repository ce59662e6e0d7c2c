"""The metre frame in which all is computed, and reprojection."""
