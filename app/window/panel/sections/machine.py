"""What computes: backend, threads, precision, arithmetic, kernel. Each change carries the state over."""

from __future__ import annotations

from app.driver import BACKENDS
from app.window.demo import THREAD_WORDS
from app.window.panel.sections.said import Said
from model.core.options import MATHS, PRECISIONS

OWN = "its own choice"
KERNELS = {  # the words of --kernel; which of them a solver has, it says itself
    "cpu": ("fused", "team", "tiled", "stages"),
    "gpu": ("one-block", "resident", "tiles", "tiled", "graph", "launch", "cooperative", "stages"),
}


def machine(said: Said) -> None:
    """One choice a row."""
    demo, rows = said.demo, said.rows
    world, options = demo.world, demo.options
    rows.note(f"{world.device}, kernel {world.kernel}, {world.threads} threads{' a block' * (world.backend == 'gpu')}")
    chosen = rows.choice("Backend", demo.backend, BACKENDS, "B")
    if chosen is not None:
        demo.switch_backend()
    if demo.backend == "cpu":
        chosen = rows.choice("Threads", demo.threads, (*THREAD_WORDS, "1", "auto"), "T: of the cores, or a number")
        if chosen is not None and demo.run_with(threads=chosen):
            demo.say(f"{demo.world.threads} threads ({chosen}), state carried over")
    for name, words in (("Precision", tuple(PRECISIONS)), ("Math", MATHS)):
        chosen = rows.choice(name, str(options[name.lower()]), words, "not live: kernels are compiled for it")
        if chosen is not None and demo.run_with(**{name.lower(): chosen}):
            demo.say(f"{chosen}, state carried over")
    now, known = options["kernel"] or OWN, (OWN, *KERNELS[demo.backend])
    chosen = rows.choice("Kernel", now, known, "which of them a solver has, it says")
    if chosen is not None and demo.run_with(kernel=None if chosen == OWN else chosen):
        demo.say(f"kernel {demo.world.kernel}, state carried over")
