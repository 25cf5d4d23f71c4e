"""Bars of tetrahedra by peers: tip.py has the exact result; one file per peer."""
