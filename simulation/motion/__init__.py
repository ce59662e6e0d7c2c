"""Ground that moves along itself and carries its roughness."""
