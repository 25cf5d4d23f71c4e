"""Background compilation: a thread warms up the worlds, so that the window keeps drawing and can be closed."""

from __future__ import annotations

import threading
from time import perf_counter

from softlab.app.window.steering import Steering


class Compiling:
    """Warms up the worlds of a demo. Call `update` at every frame; while it returns True, no world may be used.

    Worlds on a GPU are warmed up within `update`, because their streams and graphs belong to the thread that opened
    them.
    """

    def __init__(self, demo: Steering):
        self.demo = demo
        self._generation: int | None = None  # of the worlds that are warm, or being warmed up
        self._thread: threading.Thread | None = None
        self._begin = 0.0
        self._error: BaseException | None = None

    @property
    def seconds(self) -> float:
        """Time since the current worlds began to be warmed up [s]."""
        return perf_counter() - self._begin

    @property
    def running(self) -> bool:
        """True while a thread is compiling."""
        return self._thread is not None and self._thread.is_alive()

    @property
    def due(self) -> bool:
        """True if the worlds differ from those that were warmed up last."""
        return self._generation != self.demo.generation

    def update(self) -> bool:
        """Start the warm-up if it is due. Returns True while it runs. Raises its errors."""
        if self.running:
            return True
        if self.due:
            self._generation, self._begin = self.demo.generation, perf_counter()
            if self.demo.backend == "cpu":
                self._thread = threading.Thread(target=self._warm_up, daemon=True)
                self._thread.start()
                return True
            self._warm_up()
        self._thread = None
        error, self._error = self._error, None
        if error is not None:
            raise error
        return False

    def _warm_up(self) -> None:
        try:
            for world in self.demo.worlds:
                world.warm_up()
        except BaseException as error:  # told on the window's thread
            self._error = error
