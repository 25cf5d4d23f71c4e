"""What of an experiment this process measures: all of it, or, as one of several workers, the groups that it takes.

`resume` (bench/measure/experiment.py) asks before every group. Who shares a sweep among workers: bench/cluster.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager
from typing import Protocol

from softlab.bench.store.database import Store


class Share(Protocol):
    """Which groups of an experiment are this process's. Names are the same in every process that plans on such a machine."""

    def planned(self, store: Store, machine: str, groups: Mapping[str, tuple[float, str]]) -> None:
        """Hear what is to be measured on a machine: the groups that the store lacks, name -> worth and words."""
        ...

    def take(self, name: str) -> AbstractContextManager[bool]:
        """A group for as long as it is measured: whether it is this process's. What the store holds may have grown then."""
        ...


class Alone:
    """One process that measures everything."""

    def planned(self, store: Store, machine: str, groups: Mapping[str, tuple[float, str]]) -> None:
        """Nobody else asks."""

    @contextmanager
    def take(self, name: str) -> Iterator[bool]:
        yield True


_current: list[Share] = [Alone()]


def share() -> Share:
    """The share of this process."""
    return _current[-1]


@contextmanager
def sharing(mine: Share) -> Iterator[None]:
    """Within it, `mine` is the share of this process."""
    _current.append(mine)
    try:
        yield
    finally:
        _current.pop()
