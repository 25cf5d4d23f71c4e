"""The groups of an experiment that this process measures: all, or, for one of several workers, those that it claims.

`resume` (bench/measure/experiment.py) asks before every group. bench/cluster divides a sweep among workers.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager
from typing import Protocol

from softlab.bench.store.database import Store


class Partition(Protocol):
    """The groups that this process measures. Names are the same in every process on an identical machine."""

    def planned(self, store: Store, machine: str, groups: Mapping[str, tuple[float, str]]) -> None:
        """Receive the groups that the store lacks on a machine, name -> worth and description."""
        ...

    def take(self, name: str) -> AbstractContextManager[bool]:
        """Reserve a group while it is measured; False if it belongs to another process. The store may have grown by then."""
        ...


class Alone:
    """One process that measures everything."""

    def planned(self, store: Store, machine: str, groups: Mapping[str, tuple[float, str]]) -> None:
        """Do nothing: no other process claims groups."""

    @contextmanager
    def take(self, name: str) -> Iterator[bool]:
        yield True


_current: list[Partition] = [Alone()]


def current_partition() -> Partition:
    """Return the partition of this process."""
    return _current[-1]


def is_alone() -> bool:
    """Return True if no other process measures a part of the groups."""
    return isinstance(current_partition(), Alone)


@contextmanager
def use_partition(partition: Partition) -> Iterator[None]:
    """Make `partition` that of this process inside this context."""
    _current.append(partition)
    try:
        yield
    finally:
        _current.pop()
