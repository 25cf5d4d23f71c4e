"""Tuples whose length is known when a kernel is compiled, in a form that the compilers of both backends accept."""

from collections import namedtuple
from functools import cache

from softlab.model.base.variant import plain


def tuple_of(count, item, compiled=plain):
    """Make all_of(a, b, c, k) -> (item(0)(a, b, c, k), ..., item(count - 1)(a, b, c, k)); `item(n)`: a compiled
    function."""
    one = item(count - 1)

    @compiled
    def last(a, b, c, k):
        return (one(a, b, c, k),)

    all_of = last
    for n in range(count - 2, -1, -1):
        all_of = _before(item(n), all_of, compiled)
    return all_of


def _before(one, rest, compiled):
    @compiled
    def several(a, b, c, k):
        return (one(a, b, c, k), *rest(a, b, c, k))

    return several


def reader(fields, compiled=plain, prefix=""):
    """Make read(record) -> the record's values of these fields as a named tuple; `prefix` precedes their names in the
    record.

    A loop that reads the tuple keeps the values in registers; it would load those of the record again after each
    barrier.
    """
    make_tuple = named(tuple(fields))

    def value(n):
        name = prefix + fields[n]
        return compiled(lambda record, unused, unused_too, k: record[name])

    values = tuple_of(len(fields), value, compiled)

    @compiled
    def read(record):
        return make_tuple(*values(record, 0, 0, 0))

    return read


@cache
def named(fields):
    """Return the named tuple type of these fields, the same for every caller."""
    return namedtuple("Values", fields)
