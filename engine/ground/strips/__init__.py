"""Flight strips of one survey that do not fit together, and their correction."""
