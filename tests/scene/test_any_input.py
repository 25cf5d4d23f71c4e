"""Inputs of every kind, made from a seed, through the command line: no traceback, no hang, nothing left behind, and every
message is one line that ends and names what it is about.

SOFTLAB_INPUTS: how many (100); SOFTLAB_SEED: of which seed. A case is told by its number, and made again from that alone.
"""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from any_answer import answer, quiet_lab
from any_input import Maker

SEED, COUNT = int(os.environ.get("SOFTLAB_SEED", "13")), int(os.environ.get("SOFTLAB_INPUTS", "100"))


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="pipes, devices and clocks of a POSIX system")
def test_whatever_is_given_is_answered(tmp_path: Path) -> None:
    maker, found, statuses = Maker(SEED, tmp_path), [], []
    with quiet_lab():
        for _ in range(COUNT):
            case = maker.case()
            got = answer(case, tmp_path)
            statuses.append(got.status)
            if got.wrong:
                found.append(f"seed {SEED}, case {maker.number}: {[word[:100] for word in case.argv]}: {got.wrong}")
    assert not found, "\n".join(found)
    assert statuses.count(0) >= COUNT // 20 and statuses.count(2) > COUNT // 2  # some of it is good


def test_the_answers_are_looked_at(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What each look must find, of answers made up."""
    import warnings

    from any_input import Case

    from softlab import cli
    from softlab.model.base.errors import SceneError

    def told(action) -> str:
        monkeypatch.setattr(cli, "app", lambda **_: action())
        return " ".join(answer(Case(["run"], ["grid"]), tmp_path).wrong)

    def refused(message: str) -> None:
        raise SceneError("grid", 1, message)

    assert told(lambda: 0) == "" and told(lambda: refused("bad")) == ""
    assert "traceback: ZeroDivisionError" in told(lambda: 1 / 0)
    assert "warning: odd" in told(lambda: warnings.warn("odd", UserWarning, stacklevel=1))
    assert "left behind" in told(lambda: ((tmp_path / ".x.part").touch(), 0)[1])
    assert "left behind" in told(lambda: ((tmp_path / "x").touch(), refused("bad")))
    assert "tells nothing" in told(lambda: refused("a limit of inf s"))
    assert "status 7" in told(lambda: 7)
    monkeypatch.setattr("any_answer.LONGEST", 10)
    assert "characters" in told(lambda: refused("bad"))
    monkeypatch.setattr("any_answer.SECONDS", 0.2)
    assert "took over" in told(lambda: [None for _ in iter(int, 1)])
