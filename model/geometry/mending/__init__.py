"""What is mended of a mesh before it is used: vertices that are one, sheets that bound a volume, holes."""
