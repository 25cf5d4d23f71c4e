"""Partition of a scene among several processors: by rows of a sheet, by bodies, by parts of meshes."""
