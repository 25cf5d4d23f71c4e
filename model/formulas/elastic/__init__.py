"""Forces and stiffness of elastic materials, for solvers that ask for a tangent."""
