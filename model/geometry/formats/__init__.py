"""Readers of mesh files, one module a format. Nothing is mended here; model/geometry/mesh.py does that."""
