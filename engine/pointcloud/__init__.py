"""A LAS or LAZ file in, arrays out, and back; PDAL."""
