"""The lab book's table of measured stability edges."""

from __future__ import annotations

from labbook.claims.stability import edge_pairs, edge_rows
from labbook.tables import Table, table
from plots.core.data import Results, provenance
from plots.figures.stability import stability_runs


def edge_tables(results: Results) -> list[Table]:
    """Measured beside analytic edges of the linear chain, in milliseconds; no table where none was measured."""
    sources, rows = stability_runs(results)[2], edge_rows(results)
    if not rows:
        return []
    pairs = [f"{backend.upper()}, {precision} / ms" for backend, precision in edge_pairs(results)]
    head = ["Integrator", "Damping / (N s/m)", "Analytic / ms", *pairs]
    return [table(f"Largest stable step size of the linear chain. {provenance(sources)}", head, rows)]
