"""The model of many GPUs, where closed forms are known."""

from types import SimpleNamespace

import pytest
from rich.console import Console

from softlab.bench.experiments.scaling.experiment import speedups
from softlab.bench.experiments.scaling.model import (
    MASS_BYTES,
    Cluster,
    Transfer,
    predicted,
    restart,
    waiting,
    window_seconds,
)
from softlab.bench.experiments.scaling.report import counts, print_checked, print_predicted, table
from softlab.model.base.errors import SceneError
from softlab.model.domains.link import Link

FAST = Link("none", 1e-30, 1e30, "a test")
NOTHING = {"launches": 0.0, "copying": 1e30, "ends": 0.0, "jitter": 0.0}
IDEAL = Cluster(inside=FAST, across=FAST, **NOTHING)
OPEN = Transfer(hidden=False, host=0.0)


def linear(rows, columns):
    """A GPU without overhead: a nanosecond a mass."""
    return 1e-9 * rows * columns


def test_an_ideal_link_leaves_the_rows_computed_twice():
    """2 shares of 512 rows, a halo of 4 rows each: 516 rows a step where one GPU has 1024."""
    one = predicted(1024, 100, 1, IDEAL, seconds=linear)
    two = predicted(1024, 100, 2, IDEAL, 4, linear)
    assert one.step / two.step == pytest.approx(1024 / 516)


def test_an_exchange_costs_its_message_once_in_so_many_steps():
    link, size = Link("test", 1e-5, 1e9, "a test"), 8 * 100 * MASS_BYTES
    cluster = Cluster(inside=link, launches=2e-6, copying=2e9, ends=3e-6, jitter=0.0)
    found = predicted(1024, 100, 2, cluster, 8, linear, OPEN)
    assert found.exchange == pytest.approx((1e-5 + 2e-6 + 3e-6 + size / 1e9 + size / 2e9) / 8)
    assert found.waiting == pytest.approx(0.0, abs=1e-15)


def test_what_is_hidden_costs_what_a_pass_does_not_cover():
    """A pass of four steps of 520 x 100 masses takes 208 us: an exchange of 200 us costs nothing, one of 300 us the rest."""
    for seconds, cost in ((200e-6, 0.0), (300e-6, 92e-6)):
        link = Link("test", seconds, 1e30, "a test")
        found = predicted(1024, 100, 2, Cluster(inside=link, **NOTHING), 8, linear)
        assert found.exchange == pytest.approx(cost / 8, rel=1e-9, abs=1e-12)


def test_a_cycle_is_no_shorter_than_its_host_takes():
    """8 steps of 520 x 100 masses take 416 us of a GPU."""
    for host in (4e-4, 5e-4):
        found = predicted(1024, 100, 2, IDEAL, 8, linear, Transfer(False, host))
        assert found.step == pytest.approx(max(416e-6, host) / 8)


def test_the_steps_between_exchanges_are_the_quickest():
    """Of a slow link the deepest halo, of an ideal one the shallowest that lasts for a pass."""
    slow = Cluster(inside=Link("slow", 1e-3, 1e12, "a test"), **NOTHING)
    assert predicted(4096, 100, 2, slow, seconds=linear, transfer=OPEN).decomposition.steps == 64
    assert predicted(4096, 100, 2, IDEAL, seconds=linear, transfer=OPEN).decomposition.steps == 4


def test_hosts_are_linked_by_the_network():
    cluster = Cluster(per_host=4)
    assert cluster.link(4) == cluster.inside and cluster.link(5) == cluster.across


def test_without_jitter_a_cycle_is_work_and_exchange():
    for together in (False, True):
        assert waiting(16, 2.0, 0.5, 0.0, together=together, cycles=10) == pytest.approx(2.5)


def test_who_waits_for_all_waits_longer_than_who_waits_for_neighbours():
    """The mean of the largest of n exponentials is the n-th harmonic number of their mean; neighbours alone wait for less,
    yet for more than themselves."""
    near = waiting(100, 1.0, 0.0, 0.05)
    far = waiting(100, 1.0, 0.0, 0.05, together=True)
    harmonic = sum(1 / k for k in range(1, 101))
    assert far == pytest.approx(1 + 0.05 * harmonic, abs=5 * 0.05 * 1.28 / 400**0.5)  # 5 deviations of a mean of 400
    assert 1.05 < near < far


def test_the_interval_between_files_loses_least():
    """Young's: what is written costs as much as what is done again."""
    found = restart(10**12, 1000, Cluster())
    assert found.write / found.interval == pytest.approx(found.interval / (2 * found.life))
    for other in (0.9 * found.interval, 1.1 * found.interval):
        assert found.write / other + other / (2 * found.life) > found.lost


def test_weak_scaling_keeps_each_share_and_strong_scaling_ends_with_the_rows():
    weak = table(64, 1000, IDEAL, None, True, linear)
    assert [count for count, _, _ in weak] == counts(1000)
    assert all(p.decomposition.least_rows == 64 for _, p, _ in weak)
    assert weak[-1][2] == pytest.approx(64 / 72)  # four rows of halo on both sides
    assert [count for count, _, _ in table(64, 1000, IDEAL, None, False, linear)] == [1, 2, 4, 8, 16, 32, 64]


def test_windows_of_the_table_of_kernels():
    """A larger window takes longer, and no less than its share."""
    assert window_seconds(1024, 4096) < window_seconds(2048, 4096) <= 2.1 * window_seconds(1024, 4096)


def test_the_tables_are_printed(tmp_path):
    console = Console(record=True, width=120)
    print_predicted(console, 16, 4096, Cluster(), None)
    print_checked(console, tmp_path / "none.sqlite")
    told = console.export_text()
    assert (
        told.count("by the model") == 2
        and "files to restart from, on 16 GPUs" in told
        and "nothing was measured" in told
    )
    for wrong in ((0, 64), (4, 1)):
        with pytest.raises(SceneError):
            print_predicted(console, *wrong, Cluster(), None)


def test_the_model_is_held_against_what_was_measured():
    """Twice as fast on two as on one; what has no single GPU beside it is left out."""

    def point(gpus, step, rows=4096):
        rate = rows * rows / step
        return SimpleNamespace(
            machine="m", precision="float32", step=step, rate=rate, sheet="grid", rows=rows, columns=rows, gpus=gpus,
            link="flags", exchange_every=None,
        )  # fmt: skip

    ((p, faster, model),) = speedups([point(1, 4.0), point(2, 2.0), point(2, 1.0, rows=8192)])
    assert (p.gpus, faster) == (2, 2.0) and 1.5 < model < 2.0
