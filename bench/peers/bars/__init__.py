"""Bars of tetrahedra beside what a user would pick: the exact answer (tip.py), and a file a peer."""
