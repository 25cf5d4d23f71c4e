"""A grid's CUDA kernels, in plain Python: how a mass that diverged is found, and `softlab run`."""

from __future__ import annotations

import json

import numpy as np
import pytest

from softlab.gpu_backend.mass_spring.grid.kernels import make_tools


@pytest.mark.parametrize("real", [np.float32, np.float64])
def test_the_first_mass_that_left_the_finite_world_is_found(real: type) -> None:
    """By its place beyond the bound, on either side of a centre, or by a place or a velocity that is no number."""
    kind = np.complex64 if real is np.float32 else np.complex128
    wrong = [(0, 1e3 + 1), (0, -1001j), (0, complex(np.nan, 0)), (1, complex(0, np.nan)), (1, complex(np.inf, 0))]
    for which, value, bad in [*((*one, True) for one in wrong), (0, 999 + 999j, False), (1, 1e30, False)]:
        state = [np.zeros(10, kind), np.zeros(10, kind)]
        state[which][[4, 7]] = value
        result = np.full(1, 99, np.int64)
        make_tools(real).first_diverged[2, 8](*state, real(1e3), real(0), real(0), real(0), result)
        assert result[0] == (4 if bad else 99)
        moved, result[0] = [state[0] + (5e6 - 1e7j), state[1]], 99
        make_tools(real).first_diverged[2, 8](*moved, real(1e3), real(5e6), real(-1e7), real(0), result)
        assert result[0] == (4 if bad else 99)


def test_run_prints_one_json_object(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    import sys

    from softlab import cli

    command = "softlab run lab-grid --backend gpu --set grid.rows=8 --set grid.columns=8 --steps 20 --json"
    monkeypatch.setattr(sys, "argv", command.split())
    with pytest.raises(SystemExit) as caught:
        cli.main()
    assert caught.value.code in (0, None)
    report = json.loads(capsys.readouterr().out)
    assert report["backend"] == "gpu" and report["particles"] == 64 and report["outcome"] == "ok"
    assert report["error"] is None or report["error"] > 0
