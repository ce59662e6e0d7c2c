"""A moving survey onto the reference, with its error."""
