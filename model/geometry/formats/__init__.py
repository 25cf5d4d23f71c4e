"""Readers of mesh files, one module per format. Repairs are made in model/geometry/mesh.py.

meshio would read the same formats, but refuses polygons in OFF, comments in OBJ faces and .node tables, byte-order
marks, and Gmsh 4.1 elements whose entities are not listed; it does not resolve negative OBJ indices or check for faces
beyond the last vertex; and its errors name neither line nor remedy.
"""
