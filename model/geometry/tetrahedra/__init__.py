"""Tetrahedral bodies: meshes of tetrahedra and their laws (`mesh`), made of voxels (`voxels`, with `overlap`, `pieces` and
`embedding`) or read from files (`files`), and the report on them (`report`). All in float64, vectorised, the same bits on
every call."""
