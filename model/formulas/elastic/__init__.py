"""Elastic materials of tetrahedra as energies, stresses and stiffnesses (see the package above for what a factory is)."""
