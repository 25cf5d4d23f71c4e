"""Checks of a scene's parts against each other (`fit`, `tetrahedra`) and against the solver (`solver`)."""
