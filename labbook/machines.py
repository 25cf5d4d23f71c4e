"""Warning beside sentences that have times of two machines."""

from __future__ import annotations

import re

from softlab.plots.core.data import Results

APART = "Two machines: their times do not compare."
TIME = re.compile(r"\d\s(?:s|ms|\N{MICRO SIGN}s|ns)\b|a second")


def machines_apart(sentence: str, results: Results) -> str:
    """Return APART for a sentence with times or rates on processors that no single machine has, else an empty string."""
    named = [
        {source.machine.key for source in results.sources if name in (source.gpu, source.processor)}
        for name in {name for source in results.sources for name in (source.gpu, source.processor) if name}
        if re.search(rf"{re.escape(name)}(?!\w)", sentence)
    ]
    return APART if named and not set.intersection(*named) and TIME.search(sentence) else ""
