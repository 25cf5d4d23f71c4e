"""Backend, threads, precision, math and kernel. Every change keeps the state."""

from __future__ import annotations

from softlab.app.driver import BACKENDS
from softlab.app.window.demo import THREAD_WORDS
from softlab.app.window.panel.sections.frame import PanelFrame
from softlab.model.core.options import MATHS, PRECISIONS

AUTOMATIC = "automatic"
KERNELS = {  # the words of --kernel; a solver refuses those it lacks
    "cpu": ("fused", "team", "tiled", "stages"),
    "gpu": ("one-block", "resident", "tiles", "tiled", "graph", "launch", "cooperative", "stages"),
}


def machine(frame: PanelFrame) -> None:
    """Lay out one choice per row."""
    demo, rows = frame.demo, frame.rows
    world, options = demo.world, demo.options
    rows.note(
        f"{world.device}, kernel {world.kernel}, {world.threads} threads{' per block' * (world.backend == 'gpu')}"
    )
    chosen = rows.choice("Backend", demo.backend, BACKENDS, "Key B.")
    if chosen is not None:
        demo.switch_backend()
    if demo.backend == "cpu":
        chosen = rows.choice(
            "Threads", demo.threads, (*THREAD_WORDS, "1", "auto"), "Threads per core, a fixed number, or auto. Key T."
        )
        if chosen is not None and demo.run_with({}, threads=chosen):
            demo.say(f"{demo.world.threads} threads ({chosen}), state kept")
    for name, words in (("Precision", tuple(PRECISIONS)), ("Math", MATHS)):
        chosen = rows.choice(
            name, str(options[name.lower()]), words, "A change recompiles the kernels. The state is kept."
        )
        if chosen is not None and demo.run_with({name.lower(): chosen}):
            demo.say(f"{chosen}, state kept")
    now, known = options["kernel"] or AUTOMATIC, (AUTOMATIC, *KERNELS[demo.backend])
    chosen = rows.choice(
        "Kernel", now, known, "A kernel that the solver of this scene does not have is refused with a message."
    )
    if chosen is not None and demo.run_with({"kernel": None if chosen == AUTOMATIC else chosen}):
        demo.say(f"kernel {demo.world.kernel}, state kept")
