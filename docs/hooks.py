"""What the site's builder does: it finds the layers as packages of `softlab`, and links to files beside docs/, which the
site does not have, become their paths."""

from __future__ import annotations

import re
import shutil
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]


def on_startup(**_: Any) -> None:
    """Lay out the sources as they are installed, in build/api, before the builder looks for it; it imports nothing."""
    package = ROOT / "build" / "api" / "softlab"
    shutil.rmtree(package, ignore_errors=True)
    for source in ROOT.glob("*/__init__.py"):  # the package, and the layers beside it
        layer = source.parent
        target = package if layer.name == "softlab" else package / layer.name
        shutil.copytree(layer, target, ignore=shutil.ignore_patterns("__pycache__", "data"), dirs_exist_ok=True)


def on_page_markdown(markdown: str, page: Any, **_: Any) -> str:
    """Replace links to sources by their text, followed by the path unless the text contains it; links to pages stay."""
    folder = (ROOT / "docs" / page.file.src_uri).parent

    def named(link: re.Match[str]) -> str:
        text, path = link.group(1), link.group(2)
        if (folder / ".." / path).resolve().is_relative_to(ROOT / "docs"):
            return link.group(0)
        return text if path in text else f"{text} (`{path}`)"

    return re.sub(r"\[([^\]]+)\]\(\.\./([^)#]+)\)", named, markdown)
