"""One module a command: check, open, compute, write, record."""
