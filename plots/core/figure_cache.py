"""Cache of drawn figures in the user's cache folder, keyed by the contents of the figure and the drawing code.

Making a figure's parts takes a fifth of the time; the layout and the files take the rest. So a figure is made, its
parts are hashed, and if the same ones were written before, those files are used.
"""

from __future__ import annotations

import hashlib
import os
import shutil
from collections.abc import Iterator, Sequence
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from softlab.model.base.digest import source_digest
from softlab.model.base.disk_cache import user_cache
from softlab.model.base.errors import InputError
from softlab.model.base.files import replacing

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.figure import Figure

MAX_FILES = 400  # six sets of figures; the least recently used ones are removed


def key_of(figure: Figure, more: Sequence[object] = ()) -> str:
    """Return a hash of the contents of a figure before its layout, of the drawing code, and of `more`."""
    digest = hashlib.sha256(_code().encode())
    for piece in (*more, *figure.get_size_inches(), *_parts(figure)):
        content = np.ascontiguousarray(piece).tobytes() if isinstance(piece, np.ndarray) else repr(piece).encode()
        digest.update(len(content).to_bytes(8, "little") + content)
    return digest.hexdigest()[:32]


@cache
def _code() -> str:
    import matplotlib

    return f"{source_digest(Path(__file__).parent.parent)} matplotlib {matplotlib.__version__}"


def _parts(figure: Figure) -> Iterator[object]:
    """Yield the parts that depend on the data: kind, position, text and style of every part. Ticks follow from the
    axes."""
    from matplotlib.ticker import FixedLocator

    for artist in (*figure.texts, *figure.legends, *figure.patches, *figure.lines, *figure.images):
        yield from _artist(artist)
    for ax in figure.axes:
        spec = ax.get_subplotspec()
        yield spec and (spec.num1, spec.num2, *spec.get_gridspec().get_geometry(), ax.get_title(), ax.axison)
        yield spec and (spec.get_gridspec().get_height_ratios(), spec.get_gridspec().get_width_ratios())
        yield ax.get_aspect(), ax.get_position(original=True).bounds
        for axis in (ax.xaxis, ax.yaxis):
            yield axis.get_scale(), tuple(axis.get_view_interval()), axis.get_label_text(), axis.get_visible()
            for ticker in (axis.get_major_locator(), axis.get_major_formatter(), axis.get_minor_locator()):
                yield type(ticker).__name__, getattr(ticker, "seq", None)
                yield [float(at) for at in ticker()] if isinstance(ticker, FixedLocator) else None
                yield getattr(getattr(ticker, "func", None), "args", None)  # labels that were set one by one
        legend = ax.get_legend()
        for artist in (*ax.lines, *ax.collections, *ax.patches, *ax.texts, *ax.images, *((legend,) if legend else ())):
            yield from _artist(artist)


def _artist(artist: Artist) -> Iterator[object]:
    from matplotlib.collections import Collection
    from matplotlib.image import AxesImage
    from matplotlib.legend import Legend
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch
    from matplotlib.text import Text

    yield type(artist).__name__, artist.get_visible(), artist.get_alpha(), artist.get_zorder(), str(artist.get_label())
    if isinstance(artist, Legend):  # whose handles are parts themselves
        yield [text.get_text() for text in artist.get_texts()], artist.get_title().get_text()
        for handle in filter(None, artist.legend_handles):
            yield from _artist(handle)
    if isinstance(artist, Text):
        yield artist.get_text(), artist.get_position(), artist.get_fontsize(), artist.get_rotation()
        yield artist.get_horizontalalignment(), artist.get_verticalalignment()
        yield getattr(artist, "xyann", None), getattr(artist, "xy", None), str(artist.get_color())
    if isinstance(artist, Line2D):
        yield np.asarray(artist.get_xydata(), float)
        yield artist.get_linestyle(), str(artist.get_marker()), artist.get_linewidth(), artist.get_markersize()
        yield str(artist.get_color()), str(artist.get_markerfacecolor()), str(artist.get_markeredgecolor())
    if isinstance(artist, Collection):
        yield from (path.vertices for path in artist.get_paths())
        for values in (artist.get_offsets(), artist.get_facecolor(), artist.get_edgecolor(), artist.get_linewidth()):
            yield np.asarray(values, float)
        yield np.asarray([] if artist.get_array() is None else artist.get_array(), float)
    if isinstance(artist, Patch):
        yield artist.get_path().vertices, tuple(artist.get_facecolor()), tuple(artist.get_edgecolor())
        yield np.asarray(artist.get_patch_transform().get_matrix()), artist.get_hatch(), artist.get_linestyle()
    if isinstance(artist, AxesImage):
        yield np.asarray(artist.get_array()), tuple(artist.get_extent())


def fetch(key: str, suffix: str, target: Path) -> bool:
    """Copy the file of a key to `target`; return False if there is none. Raises OSError if the target cannot be
    written.
    """
    folder = user_cache("figures")
    stored = folder / f"{key}.{suffix}" if folder else None
    if stored is None or not stored.is_file():
        return False
    shutil.copyfile(stored, target)
    with suppress(OSError):
        os.utime(stored)  # marks it as used now
    return True


def store(key: str, suffix: str, drawn: Path) -> None:
    """Store a copy of a file under its key; do nothing if that is impossible."""
    folder = user_cache("figures")
    if folder is None:
        return
    with suppress(OSError, InputError):
        with replacing(folder / f"{key}.{suffix}") as part:
            shutil.copyfile(drawn, part)
        files = sorted(folder.iterdir(), key=lambda file: file.stat().st_mtime)
        for old in files[:-MAX_FILES]:
            old.unlink(missing_ok=True)
