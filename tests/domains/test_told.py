"""What is said of a scene that several share: by the plan, by the doctor."""

from types import SimpleNamespace

import pytest

from softlab.app.command import doctor_shared
from softlab.app.command.findings import Finding
from softlab.app.plan.shared import shared_plan
from softlab.model.base.errors import BackendUnavailable, SceneError
from softlab.model.domains.link import NVLINK, Link
from softlab.model.scene.scene import load_scene


def plan_of(rows, columns, gpus, every=None):
    scene = load_scene("lab-grid").replace({"grid.rows": rows, "grid.columns": columns})
    return shared_plan(scene, gpus, every, item=4)


def test_the_plan_says_who_owns_what_and_what_is_sent():
    """16 rows of 100 masses of 16 bytes (x, y, vx, vy in float32) every 16 steps."""
    found = plan_of(4096, 100, 2, every=16).as_dict()
    assert [(d["first_row"], d["end_row"], d["window_rows"]) for d in found["domains"]] == [
        (0, 2048, 2064), (2048, 4096, 2064),
    ]  # fmt: skip
    assert found["bytes_per_exchange"] == 16 * 100 * 16 and found["bytes_per_step"] == 100 * 16
    assert found["repeated_rows"] == pytest.approx(2 * 16 / 4096)
    assert found["exchange_seconds"] == pytest.approx(NVLINK.latency + 16 * 100 * 16 / NVLINK.bandwidth)


def test_the_link_allows_no_more_than_a_grid_an_exchange():
    found = plan_of(4096, 100, 2, every=4)
    assert found.most_masses * found.exchange_seconds / 4 == pytest.approx(4096 * 100)


def test_many_domains_are_not_all_listed():
    lines = plan_of(4096, 10, 64).lines()
    assert sum("owns rows" in line for line in lines) == 16 and "  and 48 more" in lines


def test_one_gpu_sends_nothing():
    found = plan_of(64, 10, 1)
    assert found.message == 0 and found.as_dict()["most_masses_per_second"] is None and found.lines()


def test_bodies_are_owned_whole_and_send_nothing():
    """Two of 314 particles and one of 314, two of 559, of 32 bytes each in float32: cut where 1030 would be half."""
    found = shared_plan(load_scene("plastic"), 2, None, item=4)
    shares = found.as_dict()["shares"]
    assert [(s["first_body"], s["end_body"], s["particles"]) for s in shares] == [(0, 3, 942), (3, 5, 1118)]
    assert found.as_dict()["bytes_per_step"] == 0 and found.as_dict()["balance"] == pytest.approx(1030 / 1118)
    first, *owners, last = found.lines()
    assert "body by body" in first and "no data is exchanged" in first
    assert owners[0] == "  GPU 0: owns bodies 0 to 2 (clay, putty, jelly), 942 particles (29.4 KiB per state)"
    assert last == "  the largest part has 54.3 % of the particles: at most 1.84 times as fast as one"


def test_slabs_say_what_they_own_hold_and_send():
    """96 columns of 48 particles, 0.025 m apart, and halos of 5 supports [4 by two iterations, 1 by viscosity] and twice half
    a support, that a particle may go, or 6 * 0.0455 m: 11 columns, the first half a distance away."""
    changes = {"water.size": [2.4, 0.3, 0.1], "method.iterations": 2}
    plan = shared_plan(load_scene("dam-break").replace(changes), 2, None, item=4)
    found = plan.as_dict()
    assert found["halo"] == pytest.approx(6 * 0.025 / 0.55, rel=2e-3) and found["bounds"] == pytest.approx([1.2])
    assert [tuple(share.values()) for share in found["shares"]] == [(48 * 48, 59 * 48, 11 * 48)] * 2
    assert found["bytes_per_step"] == 6 * 2 * 11 * 48 * (4 + 6 * 4)
    assert "owns 2304 particles to 1.2 m" in plan.lines()[1]


def test_partitions_are_told_with_what_is_repeated_and_sent():
    """Nine vertices across, of 32 bytes each in float32: layers 0 to 9 and 10 to 20 are owned, halos are of 4."""
    found = shared_plan(load_scene("fem-cantilever"), 2, None, item=4)
    told = found.as_dict()
    assert [share["particles"] for share in told["shares"]] == [90, 99]
    assert [share["window_particles"] for share in told["shares"]] == [90 + 4 * 9, 99 + 4 * 9]
    assert told["repeated_particles"] == pytest.approx(72 / 189)
    assert told["bytes_per_step"] == 60 * told["bytes_per_exchange"] == 60 * 4 * 9 * 32
    first, *owners, repeated, sent, link = found.lines()
    assert "by partitions of the mesh" in first and "60 times per step" in first
    assert owners[1] == "  GPU 1: owns 99 particles, stores 135 and 280 of 400 tetrahedra"
    assert "38.1 % of the particles" in repeated and "1.43 times as fast" in repeated
    assert "67.5 KiB per step" in sent and "NVLink" in link


def test_a_link_has_a_latency_and_a_bandwidth():
    assert Link("test", 1e-6, 1e9, "none").seconds(1000) == pytest.approx(2e-6)
    for wrong in (0.0, -1.0, float("inf")):
        with pytest.raises(SceneError, match="greater than 0"):
            Link("test", 1e-6, wrong, "none")


class Nvml:
    """A driver with so many NVLinks a GPU, and the pairs that are apart; a name that is a tuple, as in pynvml 13.615."""

    NVML_P2P_CAPS_INDEX_READ, NVML_P2P_CAPS_INDEX_WRITE, NVML_P2P_STATUS_OK, NVML_FEATURE_ENABLED = (0,), 1, 0, 1
    NVML_NVLINK_MAX_LINKS = 18
    NVMLError = LookupError

    def __init__(self, links, apart=()):
        self.links, self.apart, self.open = links, apart, 0

    def nvmlInit(self):
        self.open += 1

    def nvmlShutdown(self):
        self.open -= 1

    def nvmlDeviceGetCount(self):
        return len(self.links)

    def nvmlDeviceGetHandleByIndex(self, index):
        return index

    def nvmlDeviceGetP2PStatus(self, one, other, kind):
        assert kind in (0, 1), "as ctypes converts no tuple"
        return int({one, other} in map(set, self.apart))

    def nvmlDeviceGetNvLinkState(self, handle, link):
        if link >= self.links[handle]:
            raise LookupError
        return 1


@pytest.mark.parametrize(
    "driver, works, said",
    [
        (Nvml([18, 18, 18, 18]), True, "4 GPUs, 18 NVLinks each, each has access to the others' memory"),
        (Nvml([12, 0], apart=[(0, 1)]), False, "2 GPUs, NVLinks: 12, 0, no access to each other's memory: 0-1"),
        (Nvml([4]), False, "1 GPU, nothing to link"),
    ],
)
def test_the_doctor_says_how_gpus_are_linked(monkeypatch, driver, works, said):
    from softlab.gpu_backend.core import device

    monkeypatch.setitem(__import__("sys").modules, "pynvml", driver)
    monkeypatch.setattr(device, "gpu_available", lambda: (True, "a GPU"))
    monkeypatch.setattr(device, "simulated", lambda: False)
    found = doctor_shared.gpus_together()
    assert (found.works, found.detail) == (works, said)
    assert works or found.remedy
    assert driver.open == 0


def test_the_doctor_without_gpus_mpi_or_nccl(monkeypatch):
    from softlab.gpu_backend.core import device

    def nothing(*_: object) -> None:
        raise BackendUnavailable("nothing", "get it")

    monkeypatch.setattr(device, "gpu_available", lambda: (False, "none"))
    monkeypatch.setattr(doctor_shared, "mpiexec", nothing)
    monkeypatch.setattr(doctor_shared, "find_spec", lambda name: None)
    for check in (doctor_shared.gpus_together, doctor_shared.ranks_of_mpi, doctor_shared.gpus_by_nccl):
        found = check()
        assert isinstance(found, Finding) and not found.works and found.remedy
    monkeypatch.setattr(doctor_shared, "mpiexec", lambda: "mpiexec")
    monkeypatch.setattr(doctor_shared, "mpi_installed", lambda: None)
    monkeypatch.setattr(doctor_shared, "find_spec", lambda name: SimpleNamespace())
    assert doctor_shared.ranks_of_mpi().works and doctor_shared.gpus_by_nccl().works
