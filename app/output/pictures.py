"""Pictures as files."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from softlab.model.base.files import check_target, replacing


def write_png(path: Path | str, image: np.ndarray) -> Path:
    """Write `image` (height, width, 3 or 4) uint8, top row first, as a PNG. Raises InputError."""
    from PIL import Image

    path = check_target(path, (".png",))
    with replacing(path) as temporary:
        Image.fromarray(np.ascontiguousarray(image[:, :, :3])).save(temporary, format="PNG")
    return path
