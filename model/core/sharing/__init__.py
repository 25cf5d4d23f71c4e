"""How a scene is shared by several processors: by rows of a sheet, by bodies, by parts of meshes."""
