"""What softlab does not model, refuses, supports on one backend alone, and does not test: a section of docs/limits.md, which
limits_page.py writes. The table of parts follows from the families."""

from __future__ import annotations

from softlab.model.core.families import families

NOT_MODELLED = (
    "Fracture and tearing: springs, constraints and tetrahedra stay connected. Pins can be released (`[release]`).",
    "Joints, motors and articulated bodies. A rigid body is one cluster of particles, whose spin decays ([bounds](#bounds)).",
    "Rods: a rope is a chain of springs without twist.",
    "Plastic cloth and plastic tetrahedra. Only clusters of bodies are plastic.",
    "Air flow: wind is a force on triangles; bodies do not change it, and there is no wake behind them.",
    "Surface tension by Laplace's law: the cohesion of a fluid is not a tension in N/m (`softlab fluids --truth`).",
    "Compressible fluids, granular matter, heat, melting.",
    "Collisions of bodies with the mass-spring grid: it lies in a plane and has no colliders.",
)
ONE_BACKEND = (
    "All families run on both backends; `softlab plan SCENE` prints the kernel of each.",
    "CPU only: the converged references (NumPy, float64), `softlab busy`, processes by MPI without GPUs (`--ranks`).",
    "GPU only: flags and NCCL as links between devices, CUDA graphs, writing vertices directly into OpenGL buffers.",
)
NOT_TESTED = (
    "NVIDIA GPUs before compute capability 9.0, and other GPUs: the tests ran on an H100 and an H200.",
    "macOS and Windows: the code has branches for them, but the tests run on Linux (x86-64).",
    "Kernels on a GPU in continuous integration: there the tests compile them to PTX and run them in the CUDA simulator.",
    "Several hosts, and predictions for more than two GPUs ([several GPUs and processes](scale.md)).",
)


def lines() -> list[str]:
    """Return the section as lines of Markdown."""
    found = ["## Outside these limits", "", "### Not modelled", "", *(f"- {text}" for text in NOT_MODELLED)]
    found += [
        "",
        "### Refused",
        "",
        "A scene with a part that its family does not support is refused, and the message names the part. The families "
        "support:",
    ]
    found += ["", "| family | parts |", "| --- | --- |"]
    found += [f"| {family.name} | {', '.join(sorted(family.knows))} |" for family in families()]
    found += [
        "",
        "Position-based sheets also refuse `motion`, on both backends. "
        "A step size above the stability limit is refused, and the message names the limit (`--allow-unstable` runs it).",
    ]
    found += ["", "### One backend only", "", *(f"- {text}" for text in ONE_BACKEND)]
    return [*found, "", "### Not tested", "", *(f"- {text}" for text in NOT_TESTED)]
