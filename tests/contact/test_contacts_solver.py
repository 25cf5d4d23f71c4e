"""A cloth that touches itself, by its solver: the reference's motion, threads, what is refused."""

from __future__ import annotations


# ---------------------------------------------------------------------- in the solver


# ---------------------------------------------------------------------- scenes that cannot be
