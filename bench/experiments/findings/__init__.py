"""Small experiments behind single sentences of the lab book.

`experiment` has most of them, `costs` and `determinism` the costs of checks and of a fixed order; the other files are
the alternatives for comparison.
"""
