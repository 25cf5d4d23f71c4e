"""A scene that is stepped in windows, simulations of its parts: the common methods for any kind of part."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import replace
from typing import Any, TypeVar

import numpy as np

from softlab.model.base.errors import SceneError
from softlab.model.core.build import Body
from softlab.model.core.family import Field, written
from softlab.model.core.options import Options
from softlab.model.core.simulation import Simulation
from softlab.model.domains.exchange import Exchange
from softlab.model.scene.scene import Scene

T = TypeVar("T")

NOBODY = 2**62  # exceeds any particle's number


def refuse_targets(options: Options) -> None:
    """Raise SceneError for live targets."""
    if "targets" in options.live:
        raise SceneError("live", "targets", "belong to all pinned vertices; run the scene on one GPU or process")


class WindowedSimulation(Simulation):
    """A simulation that consists of windows; see model/core/simulation.py for its methods.

    `windows`: those of this process, simulations of their own; `firsts`: the numbers of their first particles in the
    whole; `exchange`: connects them to all others. A backend opens the windows (`_open`) and connects them
    (`_connect`).
    """

    exchange: Exchange
    windows: list[Any]
    firsts: list[int]

    def _open_windows(self, count: int, parts: Sequence[tuple[Scene, Options, Body]]) -> None:
        """Open the windows of this process, of `count` in all; `parts`: scene, options and initial particles of
        each."""
        self.windows = []
        try:
            for place, (scene, options, body) in enumerate(parts):
                with self._at(place):
                    window = self._open(place, scene, replace(options, body=body))
                    window._bound, window._centre = self._bound, self._centre
                    self.windows.append(window)
            self.kernel, self.threads = self.windows[0].kernel, self.windows[0].threads
            self.device = f"{count} x {self.windows[0].device}"
            self.exchange = self._connect()
            self._parameters_changed()
            self.reset()
        except BaseException:
            self.close()
            raise

    def _open(self, place: int, scene: Scene, options: Options) -> Simulation:
        """Return the simulation of window number `place` of this process."""
        raise NotImplementedError

    def _connect(self) -> Exchange:
        """Return the exchange of the windows, which have been opened."""
        raise NotImplementedError

    def _at(self, place: int) -> AbstractContextManager[object]:
        """Return the context (the device) for window number `place` of this process."""
        return nullcontext()

    def _each(self, do: Callable[..., T], beside: Sequence[object] | None = None) -> list[T]:
        """Return the results of `do(window)` for each of this process, or of `do(window, one)` with one of `beside` for
        each window."""
        results = []
        each = zip(self.windows) if beside is None else zip(self.windows, beside, strict=True)
        for place, arguments in enumerate(each):
            with self._at(place):
                results.append(do(*arguments))
        return results

    def _hand_on(self, window: Simulation, poked: int) -> None:
        """Pass changes to a window in which the poked particle has the number `poked`; -1: it is in another window."""
        window._record, window._clock = self._record, self._clock
        window._poke_particle, window._poke_force = poked, self._poke_force
        window._parameters_changed()

    def _run_each(self, first: int, steps: int) -> None:
        """Run `steps` steps of every window, numbered from `first`."""
        for place, window in enumerate(self.windows):
            window.step = first
            with self._at(place):
                window._run(steps)

    @property
    def rank(self) -> int:
        return self.exchange.rank

    def slowest(self, seconds: float) -> float:
        return self.exchange.largest(seconds)

    # ------------------------------------------------------------------ methods of Simulation

    def _store_snapshot(self) -> None:
        self._each(lambda window: window._store_snapshot())

    def _restore(self) -> None:
        self._each(lambda window: window._restore())

    def _first_diverged(self) -> int:
        """Return the lowest index of a diverged particle, or -1. Halos may be included, since they are as right as
        their owners."""
        lowest = NOBODY
        for bad in self._diverged():
            if bad >= 0:
                lowest = min(lowest, bad)
        lowest = int(-self.exchange.largest(-lowest))
        return -1 if lowest == NOBODY else lowest

    def _diverged(self) -> list[int]:
        """Return for each window of this process the global number of its first diverged particle, or -1."""
        bad_of_each = self._each(lambda window: window._first_diverged())
        return [bad if bad < 0 else first + bad for first, bad in zip(self.firsts, bad_of_each, strict=True)]

    def _read_field(self, field: Field, into: object) -> Any:
        """Return a number of the run as the sum over all windows: of a fluid, particles in several count several
        times."""
        if field.rows != "one":
            return super()._read_field(field, into)
        counts = self._each(lambda window: float(window._read_field(field, None)))
        total = int(self.exchange.gather(np.array(counts).reshape(-1, 1)).sum())
        return written(total - self.lost_when_opened.get(field.name, 0), into)

    def synchronize(self) -> None:
        self._each(lambda window: window.synchronize())

    def close(self) -> None:
        super().close()
        self._each(lambda window: window.close())
        self.windows = []
        if "exchange" in self.__dict__:
            self.exchange.close()
