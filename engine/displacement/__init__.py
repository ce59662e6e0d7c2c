"""How far ground has moved along its surface: displacement vectors of two registered surveys."""
