"""Small experiments behind single sentences of the lab book: `experiment` most of them, `costs` and `determinism` of what the
lab's own care costs; the rest is what they are timed against."""
