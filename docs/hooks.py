"""What the site's builder does to pages: links to files beside docs/, which the sources have and the site has not, become
their paths."""

from __future__ import annotations

import re
from typing import Any


def on_page_markdown(markdown: str, **_: Any) -> str:
    """`[text](../app/window/grip.py)` -> `text` (or the path itself, where the text is no more than that)."""

    def named(link: re.Match[str]) -> str:
        text, path = link.group(1), link.group(2)
        return text if path in text else f"{text} (`{path}`)"

    return re.sub(r"\[([^\]]+)\]\(\.\./([^)#]+)\)", named, markdown)
