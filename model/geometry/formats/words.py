"""The words of a text, read in order."""

from __future__ import annotations

import numpy as np

from softlab.model.base.errors import InputError
from softlab.model.geometry.formats.source import Refusal, reals, wholes


def refusal_among(what: str) -> Refusal:
    """Return the refusal of a file with a word among its numbers of `what`."""
    return lambda _, reason: InputError(f"among its {what}, {reason}; export it again")


class Words:
    """The words of a text and a position among them."""

    def __init__(self, text: str) -> None:
        self.words, self.at = text.split(), 0

    def take(self, count: int, what: str) -> list[str]:
        """Return the next `count` words. Raises InputError: fewer are left."""
        if not 0 <= count <= len(self.words) - self.at:
            raise InputError(
                f"{count} numbers of {what} promised, {len(self.words) - self.at} found: cut short or damaged; export it "
                "again"
            )
        self.at += count
        return self.words[self.at - count : self.at]

    def counts(self, count: int, what: str) -> list[int]:
        """Return the next `count` words as whole numbers."""
        return [int(number) for number in self.whole(count, what)]

    def whole(self, count: int, what: str) -> np.ndarray:
        """Return the next `count` words as (count,) int64."""
        return wholes(self.take(count, what), count, refusal_among(what))

    def real(self, count: int, what: str) -> np.ndarray:
        """Return the next `count` words as (count,) float64."""
        return reals(self.take(count, what), count, refusal_among(what))

    def upto(self, word: str) -> bool:
        """Advance past the next `word`. Returns False if there is none."""
        try:
            self.at = self.words.index(word, self.at) + 1
        except ValueError:
            return False
        return True
