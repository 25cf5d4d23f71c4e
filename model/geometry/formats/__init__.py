"""Readers of mesh files, one module a format. Nothing is mended here; model/geometry/mesh.py does that.

meshio would read the same formats, but refuses polygons in OFF, comments in OBJ faces and .node tables, byte-order marks,
and Gmsh 4.1 elements whose entities are not listed; it takes negative OBJ indices and faces beyond the last vertex as they
are; and its errors name neither line nor remedy.
"""
