"""Locks that end with their process, whatever ends it: CPU threads have the host alone, GPUs share it among each other."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from softlab.bench.cluster import turns
from softlab.bench.cluster.turns import Turn, locked, try_lock
from softlab.model.base.errors import InputError

HOLD = """
import sys
from pathlib import Path
from softlab.bench.cluster.turns import try_lock
lock = try_lock(Path(sys.argv[1]), sys.argv[2] == "shared")
print("locked" if lock else "refused", flush=True)
sys.stdin.read()
"""


def holder(file: Path, way: str) -> tuple[subprocess.Popen[str], str]:
    """Another process that asks for a lock and keeps it, and what it was told."""
    process = subprocess.Popen(
        [sys.executable, "-c", HOLD, str(file), way], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )
    assert process.stdout is not None
    return process, process.stdout.readline().strip()


@pytest.mark.parametrize(
    ("theirs", "ours", "granted"),
    [("alone", False, False), ("alone", True, False), ("shared", False, False), ("shared", True, True)],
)
def test_a_lock_is_shared_only_by_those_who_all_share_it(
    tmp_path: Path, theirs: str, ours: bool, granted: bool
) -> None:
    process, told = holder(tmp_path / "lock", theirs)
    try:
        assert told == "locked"
        lock = try_lock(tmp_path / "lock", ours)
        assert (lock is not None) == granted
        if lock is not None:
            lock.close()
    finally:
        process.kill()
        process.communicate()
    lock = try_lock(tmp_path / "lock")
    assert lock is not None, "a process that was killed holds nothing"
    lock.close()


def test_who_waits_looks_up_and_gets_it_when_the_other_is_gone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(turns, "CHECK_SECONDS", 0.01)
    process, _ = holder(tmp_path / "lock", "alone")
    looks: list[int] = []

    def look() -> None:
        looks.append(1)
        if len(looks) == 3:
            process.kill()
            process.wait()

    with locked(tmp_path / "lock", waiting=look):
        assert len(looks) >= 3
    process.communicate()


def test_gpus_take_turns_each_by_itself_and_none_beside_cpu_threads(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setattr(turns, "CHECK_SECONDS", 0.0)

    class Busy(Exception):
        pass

    def busy() -> None:
        raise Busy

    def turn(*backends: str, device: str | None = None) -> Turn:
        return Turn(backends, device, busy)

    one, two, again = turn("gpu", device="a"), turn("gpu", device="b"), turn("gpu", device="a")
    cpu, both, nothing = turn("cpu"), turn("cpu", "gpu"), turn()
    one.begin()
    one.begin()  # who has it has it
    two.begin()
    nothing.begin()  # what times nothing waits for nobody
    for other in (again, cpu, both):
        with pytest.raises(Busy):
            other.begin()
    one.end()
    again.begin()
    again.end()
    two.end()
    both.begin()
    for other in (one, cpu):
        with pytest.raises(Busy):
            other.begin()
    both.end()
    cpu.begin()
    cpu.end()


def test_where_nothing_can_be_locked_the_remedy_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
    with pytest.raises(InputError, match="XDG_CACHE_HOME"):
        Turn(["cpu"]).begin()
    with pytest.raises(InputError, match="cannot be locked"):
        try_lock(tmp_path)
