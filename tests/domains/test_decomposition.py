"""Who owns what: each row has one owner, a halo holds what its neighbour owns, and lasts as long as it is told to."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from softlab.model.base.errors import SceneError
from softlab.model.core.sharing.decomposition import Stencil, decompose

REACHES = [
    Stencil(),
    Stencil(forces=4),
    Stencil(more=1),
    Stencil(rows=2),
    Stencil(unit=2),
    Stencil(more=1, unit=2),
    Stencil(rows=4, more=2, unit=4, parts=6),
]

CUTS = given(
    rows=st.integers(1, 400), count=st.integers(1, 40), steps=st.none() | st.integers(1, 20),
    reach=st.sampled_from(REACHES),
)  # fmt: skip


def cut(rows, count, reach, steps=None):
    """The decomposition, or None where it is refused."""
    try:
        return decompose(rows, 5, count, reach, steps)
    except SceneError:
        return None


@CUTS
def test_every_row_has_one_owner(rows, count, steps, reach):
    found = cut(rows, count, reach, steps)
    if found is None:
        return
    owned = [row for domain in found.domains for row in range(domain.first, domain.end)]
    assert owned == list(range(rows))
    sizes = [domain.end - domain.first for domain in found.domains]
    assert max(sizes) - min(sizes) <= 2 * reach.unit - 1  # a unit, and rows that are no whole one


@CUTS
def test_an_exchange_fills_every_halo_with_what_its_neighbour_owns(rows, count, steps, reach):
    found = cut(rows, count, reach, steps)
    if found is None:
        return
    whole = np.arange(rows)
    held = []
    for domain in found.domains:
        window = np.full(domain.window_rows, -1)
        window[domain.owned] = whole[domain.first : domain.end]
        held.append(window)
    sent = [held[border.source][border.from_row : border.from_row + border.rows].copy() for border in found.borders]
    for border, rows_sent in zip(found.borders, sent, strict=True):
        assert (rows_sent >= 0).all(), "a sender owns what it sends"
        held[border.target][border.to_row : border.to_row + border.rows] = rows_sent
    for domain, window in zip(found.domains, held, strict=True):
        assert (window == whole[domain.window_first : domain.window_end]).all()
        assert domain.window_first % reach.unit == 0


@CUTS
def test_the_halo_lasts_until_the_next_exchange(rows, count, steps, reach):
    """What is bad spreads by `reach.rows` rows an evaluation of the forces, and once by `reach.more`, from each cut edge."""
    found = cut(rows, count, reach, steps)
    if found is None:
        return
    parts = found.steps * reach.parts // found.divided
    assert found.divided == 1 or (found.steps == 1 and reach.parts % found.divided == 0)
    for domain in found.domains:
        good = np.ones(domain.window_rows, bool)
        for spread in [reach.rows] * (reach.forces * parts) + [reach.more]:
            edges = good.copy()
            if domain.window_first > 0:
                edges[:spread] = False
            if domain.window_end < rows:
                edges[len(edges) - spread :] = False
            for far in range(1, min(spread, len(good) - 1) + 1):
                edges[far:] &= good[:-far]
                edges[:-far] &= good[far:]
            good = edges
        assert good[domain.owned].all()


def test_a_step_that_reaches_too_far_is_shared_in_parts():
    """30 substeps of 4 rows, and 2 more: 122 rows for a whole step, rounded up to 124 of a share's 2048; 6 of them ask for
    26, so 28: a sixty-fourth at most. --exchange-every counts whole steps."""
    reach = Stencil(rows=4, more=2, unit=4, parts=30)
    found = decompose(4096, 10, 2, reach)
    assert (found.divided, found.steps, found.halo, found.interval) == (5, 1, 28, pytest.approx(1 / 5))
    whole = decompose(4096, 10, 2, reach, 1)
    assert (whole.divided, whole.steps, whole.halo, whole.interval) == (1, 1, 124, 1)
    with pytest.raises(SceneError, match="leave it out"):
        decompose(200, 10, 2, reach, 1)


def test_a_share_must_hold_a_halo():
    """Runge-Kutta's step evaluates forces four times, one after another: it reads four rows beyond."""
    assert decompose(16, 5, 4, Stencil(forces=4)).halo == 4
    with pytest.raises(SceneError, match="use at most 4"):
        decompose(16, 5, 5, Stencil(forces=4))
    with pytest.raises(SceneError, match="use at most 1"):
        decompose(16, 5, 4, Stencil(forces=4), steps=2)


def test_one_owns_all_and_sends_nothing():
    alone = decompose(16, 5, 1, Stencil())
    assert not alone.borders and alone.repeated == 1 and alone.bytes_sent(16) == 0


def test_the_bytes_of_a_message():
    """A halo of 8 rows of 100 masses of 16 bytes."""
    assert decompose(1024, 100, 2, Stencil(), steps=8).bytes_sent(16) == 8 * 100 * 16
