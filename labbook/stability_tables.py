"""The lab book's table of measured stability edges."""

from __future__ import annotations

from labbook.stability_claims import edge_pairs, edge_rows
from labbook.tables import Table, table
from plots.data import Results
from plots.stability import stable_source


def edge_tables(results: Results) -> list[Table]:
    """Measured beside analytic edges of the linear chain, in milliseconds; no table where none was measured."""
    source, rows = stable_source(results), edge_rows(results)
    if source is None or not rows:
        return []
    pairs = [f"{backend.upper()}, {precision} / ms" for backend, precision in edge_pairs(results)]
    head = ["Integrator", "Damping / (N s/m)", "Analytic / ms", *pairs]
    return [table(f"Largest stable step size of the linear chain. {source.provenance}", head, rows)]
