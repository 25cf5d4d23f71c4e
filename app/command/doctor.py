"""Checks of this machine, with the command that installs each missing thing."""

from __future__ import annotations

import os
import platform
from collections.abc import Callable
from pathlib import Path

from softlab.app.command.doctor_shared import gpus_by_nccl, gpus_together, ranks_of_mpi
from softlab.app.command.findings import Finding


def _missing(name: str, text: str) -> Finding:
    """Return a finding from a text that names the missing thing and, after a semicolon, the remedy."""
    missing, _, remedy = text.partition("; ")
    return Finding(name, False, missing, remedy)


def _versions() -> Finding:
    from importlib.metadata import PackageNotFoundError, version

    def of(name: str) -> str:
        try:
            return version(name)
        except PackageNotFoundError:
            return "not installed"

    names = ("numba", "numpy", "numba-cuda", "pyglet", "matplotlib", "typst")
    return Finding("versions", True, f"Python {platform.python_version()}, " + ", ".join(f"{n} {of(n)}" for n in names))


def _cpu() -> Finding:
    from softlab.cpu_backend.core import subnormals
    from softlab.cpu_backend.core.processor import processor_name
    from softlab.cpu_backend.core.threads import core_count, thread_count, threading_layer, wait_policy

    try:
        thread_count("4x")
    except Exception as error:
        return Finding("cpu threads", False, str(error), f"export NUMBA_NUM_THREADS={4 * core_count()}")
    layer = threading_layer()
    text = f"{processor_name()}, {core_count()} cores; threading layer {layer}, wait policy {wait_policy()}"
    text += f"; {subnormals.description()}"
    remedy = (
        "" if layer == "omp" else "the OpenMP layer is the fastest: install libgomp (Debian: apt-get install libgomp1)"
    )
    return Finding("cpu threads", True, text, remedy)


def _cache() -> Finding:
    from softlab.model.base.kernel_cache import folder

    if folder() is not None:
        return Finding("compile cache", True, f"compiled kernels are kept between runs in {folder()}")
    return Finding(
        "compile cache",
        False,
        "no writable folder, so every run compiles again",
        "make ~/.cache writable, or name another folder: export NUMBA_CACHE_DIR=/tmp/softlab",
    )


def _gpu() -> Finding:
    from softlab.gpu_backend.core.device import gpu_available, simulated

    works, text = gpu_available()
    if not works:
        return _missing("gpu", text)
    if simulated():
        return Finding(
            "gpu", True, f"{text}: for tests only, very slow", "unset NUMBA_ENABLE_CUDASIM to use a real GPU"
        )
    from softlab.app.driver import open_simulation
    from softlab.model.base.errors import SoftlabError
    from softlab.model.scene.scene import load_scene

    try:
        with open_simulation(load_scene("lab-grid"), "gpu") as simulation:
            simulation.advance(8)
            simulation.state()
    except SoftlabError as error:
        return Finding("gpu", False, f"{text}, but it cannot run the lab: {error}")
    except Exception as error:
        return Finding(
            "gpu",
            False,
            f"{text}, but a kernel failed: {error}",
            "check that the toolkit fits the driver: README.md, With an NVIDIA GPU",
        )
    return Finding("gpu", True, f"{text}: runs the lab grid")


def _opengl() -> Finding:
    from softlab.app.output.offscreen import opengl_available

    works, text = opengl_available()
    if works:
        return Finding("drawing off-screen", True, text)
    return _missing("drawing off-screen", text)


def _display() -> Finding:
    if platform.system() != "Linux" or os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"):
        return Finding("window", True, "a display is available for softlab demo")
    return Finding(
        "window", False, "no display", "run on a desktop, or draw without one: softlab run SCENE --render frame.png"
    )


def _panel() -> Finding:
    from softlab.app.command.dear_imgui import REMEDY, panel_available

    works, detail = panel_available()
    return Finding("panel of the window", works, detail, "" if works else f"{REMEDY}; all keys work without it")


def _fonts() -> Finding:
    from matplotlib import font_manager

    path = Path(font_manager.findfont("DejaVu Sans"))
    system = [p for p in font_manager.findSystemFonts()]
    text = f"{path.name} for figures; {len(system)} system fonts for the window"
    if system or platform.system() != "Linux":
        return Finding("fonts", True, text)
    return Finding("fonts", False, text, "Debian: apt-get install fontconfig fonts-dejavu-core")


def _ffmpeg() -> Finding:
    from softlab.app.output.video import ffmpeg_path
    from softlab.model.base.errors import SoftlabError

    try:
        return Finding("ffmpeg", True, Path(ffmpeg_path()).name)
    except SoftlabError as error:
        return Finding("ffmpeg", False, str(error), "pip install imageio-ffmpeg")


def _voice() -> Finding:
    from softlab.app.output.voice import REMEDY, voice_available

    speaks, detail = voice_available()
    if speaks:
        return Finding("voice of the film", True, detail)
    return Finding("voice of the film", False, f"captions only: {detail}", REMEDY)


def _typst() -> Finding:
    try:
        import typst
    except ImportError as error:
        return Finding("lab book (typst)", False, str(error), "pip install typst")
    return Finding(
        "lab book (typst)", True, f"typst {typst.__version__}" if hasattr(typst, "__version__") else "installed"
    )


CHECKS: tuple[Callable[[], Finding], ...] = (
    _versions, _cpu, _cache, _gpu, gpus_together, ranks_of_mpi, gpus_by_nccl, _opengl, _display, _panel,
    _fonts, _ffmpeg, _voice, _typst,
)  # fmt: skip


def examine() -> list[Finding]:
    """Return every finding; a check that itself fails is a finding too, never a traceback."""
    findings = []
    for check in CHECKS:
        try:
            findings.append(check())
        except Exception as error:
            findings.append(Finding(check.__name__.strip("_"), False, f"{type(error).__name__}: {error}"))
    return findings
