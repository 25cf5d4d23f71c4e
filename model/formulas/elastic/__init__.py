"""Elastic materials of tetrahedra as energies, stresses and stiffnesses (see model/formulas for what a factory is)."""
