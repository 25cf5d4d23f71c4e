"""The code that docs/kernels.md quotes stands in the sources."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
QUOTES = re.findall(r"```python\n# (\S+)\n(.*?)```", (ROOT / "docs/kernels.md").read_text(encoding="utf-8"), re.S)


def squeezed(text: str) -> str:
    """Return the text without white space and trailing commas before a bracket: layout is the formatter's choice."""
    return re.sub(r"#.*", "", text).replace(" ", "").replace("\n", "").replace(",)", ")")


@pytest.mark.parametrize(("path", "code"), QUOTES, ids=[f"{path}-{n}" for n, (path, _) in enumerate(QUOTES)])
def test_what_the_page_quotes_stands_in_the_source(path: str, code: str) -> None:
    assert squeezed(code) in squeezed((ROOT / path).read_text(encoding="utf-8"))


def test_the_page_quotes_both_backends() -> None:
    assert {path.split("/")[0] for path, _ in QUOTES} == {"cpu_backend", "gpu_backend"}
