"""Bytes of a mesh file: read with a check of the memory, Git LFS pointers and wide encodings refused, text made plain."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Sequence
from itertools import islice
from pathlib import Path

import numpy as np

from softlab.model.base.errors import InputError, shortened
from softlab.model.base.files import SAMPLE, check_pointer, check_source
from softlab.model.base.memory import available_bytes, readable
from softlab.model.base.waiting import steps

BYTES_PER_FILE_BYTE = 25  # of memory while a file is read and mended: 8 to 18 measured with a million vertices
Refusal = Callable[[int, str], InputError]  # of the index of a token that is no number, and the reason
READING = "reading the mesh"  # shown while it takes long
LINES = 1 << 15  # of a text read at once
LARGEST_WHOLE = 2.0**53  # below it float64 holds whole numbers
MARK = b"\xef\xbb\xbf"  # byte-order mark of UTF-8
WIDE_MARKS = (  # UTF-32 first: its little-endian mark begins with that of UTF-16
    (b"\xff\xfe\0\0", "UTF-32"),
    (b"\0\0\xfe\xff", "UTF-32"),
    (b"\xff\xfe", "UTF-16"),
    (b"\xfe\xff", "UTF-16"),
)


def read_bytes(path: Path, what: str, bytes_per_byte: int = BYTES_PER_FILE_BYTE) -> bytes:
    """Return the bytes of `path` without a byte-order mark. `what`: see `check_source`.

    Raises InputError: no file, too large for the memory that is free, a Git LFS pointer, text in UTF-16 or UTF-32.
    """
    check_source(path, what)
    try:
        needed, free = path.stat().st_size * bytes_per_byte, available_bytes()
        if needed > free:
            raise InputError(
                f"{path} needs about {readable(needed)} of memory, of which {readable(free)} is free; decimate the mesh"
            )
        data = path.read_bytes()
    except OSError as error:
        raise InputError(f"{path} cannot be read: {error.strerror or error}") from None
    check_encoding(path, data)
    return data.removeprefix(MARK)


def check_encoding(path: Path, data: bytes) -> None:
    """Raise InputError for the first bytes of a Git LFS pointer, or of text in UTF-16 or UTF-32."""
    check_pointer(path, data[:SAMPLE])
    wide = next((name for mark, name in WIDE_MARKS if data.startswith(mark)), None) or _wide(data[:SAMPLE])
    if wide:
        raise InputError(f"{path} is text in {wide}; save it as UTF-8")


def _wide(sample: bytes) -> str | None:
    """Return the encoding of text without a byte-order mark whose characters take 2 or 4 bytes, else None."""
    for width, name in ((4, "UTF-32"), (2, "UTF-16")):
        whole = sample[: len(sample) // width * width]
        columns = [whole[k::width] for k in range(width)]
        filled = [column for column in columns if column.strip(b"\0")]
        if len(whole) >= 2 * width and len(filled) == 1 and all(9 <= byte < 127 for byte in filled[0]):
            return name
    return None


def plain(data: bytes) -> bytes:
    """Return text with the line ends of Windows and of old Macs as newlines."""
    return data.replace(b"\r\n", b"\n").replace(b"\r", b"\n") if b"\r" in data else data


def without_comments(text: bytes) -> bytes:
    """Return text without comments, from a # to the end of the line; the number of lines stays."""
    return re.sub(rb"#[^\n]*", b"", text) if b"#" in text else text


def joined(text: bytes) -> bytes:
    """Return text whose lines that end in a backslash continue in the next one; the number of lines stays."""
    if b"\\" not in text:
        return text

    def one(match: re.Match[bytes]) -> bytes:
        lines = re.split(rb"\\[ \t]*\n", match[0])
        return b" ".join(lines) + b"\n" * (len(lines) - 1)

    return re.sub(rb"[^\n]*\\[ \t]*\n(?:[^\n]*\\[ \t]*\n)*[^\n]*", one, text)


def line_of(text: bytes, pattern: bytes, number: int) -> str:
    """Return `line N` of match `number` (from 0) of the pattern in `text`, lines counted from 1; empty where it has none."""
    match = next(islice(re.finditer(pattern, text, re.MULTILINE), number, None), None)
    if match is None:
        return ""
    before = text.count(b"\n", 0, match.start())
    return f"line {before + 1}"


def word(token: bytes | str) -> str:
    """Return a token of a file as a message shows it."""
    text = token if isinstance(token, str) else token.decode("utf-8", "replace")
    return f"'{shortened(text, 40)}'"


def table(lines: Sequence[bytes], columns: int) -> np.ndarray | None:
    """Return the numbers of lines with equally many numbers, `columns` or more: (lines, numbers) float64. None for
    other lines, which the caller reads one by one, with error messages."""
    blocks: list[np.ndarray] = []
    begins = range(0, len(lines), LINES)
    try:
        for begin in steps(begins, len(begins), READING):
            if not lines[begin].strip():
                return None
            block = np.loadtxt(lines[begin : begin + LINES], np.float64, comments=None, ndmin=2)
            if len(block) != min(LINES, len(lines) - begin) or block.shape[1] != (blocks or [block])[0].shape[1]:
                return None
            blocks.append(block)
    except ValueError:
        return None
    return np.concatenate(blocks) if blocks and blocks[0].shape[1] >= columns else None


def polygon_table(lines: Sequence[bytes]) -> np.ndarray | None:
    """Return the corners of polygons (faces, k) int64, from lines of their number and themselves; None as of `table`."""
    rows = whole_table(lines, 4)
    if rows is None or rows[0, 0] < 3 or rows[0, 0] >= rows.shape[1] or (rows[:, 0] != rows[0, 0]).any():
        return None
    return np.ascontiguousarray(rows[:, 1 : 1 + rows[0, 0]])


def whole_table(lines: Sequence[bytes], columns: int) -> np.ndarray | None:
    """Return `table` of whole numbers as int64; None where one is not."""
    rows = table(lines, columns)
    if rows is None or not ((np.rint(rows) == rows) & (np.abs(rows) < LARGEST_WHOLE)).all():
        return None
    return rows.astype(np.int64)


def refusal(kind: str, where: Callable[[int], str]) -> Refusal:
    """Return the refusal of a file of this kind that names the line `where(token)`."""
    return lambda token, reason: InputError(f"it cannot be read as {kind}: {reason} ({where(token)}); export it again")


def row_of(token: int, sizes: np.ndarray) -> int:
    """Return the row of a token, of rows of these sizes."""
    return int(np.searchsorted(np.cumsum(sizes), token, "right"))


def reals(tokens: Iterable[bytes | str], count: int, refused: Refusal) -> np.ndarray:
    """Return `count` tokens as (count,) float64. Raises `refused`."""
    return _converted(tokens, count, refused, np.float64, float)


def wholes(tokens: Iterable[bytes | str], count: int, refused: Refusal) -> np.ndarray:
    """Return `count` tokens as (count,) int64. Raises `refused`."""
    return _converted(tokens, count, refused, np.int64, int)


def _converted(tokens: Iterable[bytes | str], count: int, refused: Refusal, dtype: type, convert: type) -> np.ndarray:
    tokens = list(tokens)
    try:
        return np.fromiter(map(convert, tokens), dtype, count)
    except (ValueError, OverflowError):
        for number, token in enumerate(tokens):
            try:
                np.dtype(dtype).type(convert(token))
            except (ValueError, OverflowError):
                kind = "a number" if convert is float else "a whole number"
                comma = "; write decimals with a point" if "," in word(token) else ""
                raise refused(number, f"{word(token)} is not {kind}{comma}") from None
        raise
