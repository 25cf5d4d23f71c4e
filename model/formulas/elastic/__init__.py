"""Elastic materials of tetrahedra: energies, stresses and stiffnesses."""
