"""Tuples of a number of things that is known when a kernel is made, as both backends' compilers take them."""

from model.formulas import plain


def tuple_of(count, item, compiled=plain):
    """all_of(a, b, c, k) -> (item(0)(a, b, c, k), ..., item(count - 1)(a, b, c, k)); `item(n)`: a compiled function."""
    one = item(count - 1)

    @compiled
    def last(a, b, c, k):
        return (one(a, b, c, k),)

    found = last
    for n in range(count - 2, -1, -1):
        found = _before(item(n), found, compiled)
    return found


def _before(one, rest, compiled):
    @compiled
    def several(a, b, c, k):
        return (one(a, b, c, k), *rest(a, b, c, k))

    return several


def each_of(count, item, compiled=plain):
    """every(a, b, c, k, given): calls item(n)(a, b, c, k, given[n]) for n = 0 ... count - 1."""
    found = None
    for n in range(count - 1, -1, -1):
        found = _calls(n, item(n), found, compiled)
    return found


def _calls(n, one, rest, compiled):
    more = rest is not None

    @compiled
    def every(a, b, c, k, given):
        one(a, b, c, k, given[n])
        if more:
            rest(a, b, c, k, given)

    return every
