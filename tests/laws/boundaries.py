"""What softlab does not model, refuses, supports on one backend alone, and does not test: a section of docs/limits.md, which
limits_page.py writes. The table of parts follows from the families."""

from __future__ import annotations

from softlab.model.core.families import families

NOT_MODELLED = (
    "Fracture and tearing: springs, constraints and tetrahedra stay connected. Pins may let go (`[release]`).",
    "Joints, motors and articulated bodies. A rigid body is one cluster of particles, whose spin decays ([bounds](#bounds)).",
    "Rods: a rope is a chain of springs without twist.",
    "Plastic cloth and plastic tetrahedra. Only clusters of bodies are plastic.",
    "Air: wind is a force on triangles; it is not changed by what it meets, and a flow behind a body does not exist.",
    "Surface tension by Laplace's law: the cohesion of a fluid is no tension in N/m (`softlab fluids --truth`).",
    "Compressible fluids, granular matter, heat, melting.",
    "Collisions of bodies with the mass-spring grid: it lies in a plane and has no colliders.",
)
ONE_BACKEND = (
    "All families run on both backends; `softlab plan SCENE` prints the kernel of each.",
    "CPU only: the converged references (NumPy, float64), `softlab busy`, processes by MPI without GPUs (`--ranks`).",
    "GPU only: flags and NCCL as links between devices, CUDA graphs, vertices written into OpenGL's buffers.",
)
NOT_TESTED = (
    "GPUs other than NVIDIA's, and NVIDIA's before compute capability 9.0: the tests ran on an H100 and an H200.",
    "macOS and Windows: the code has their branches, the tests run on Linux (x86-64).",
    "Kernels on a GPU in continuous integration: without a GPU the tests compile them to PTX and run them in the CUDA "
    "simulator.",
    "Several hosts, and predictions for more than two GPUs ([several GPUs and processes](scale.md)).",
)


def lines() -> list[str]:
    """Return the section as lines of Markdown."""
    found = ["## Outside these limits", "", "### Not modelled", "", *(f"- {text}" for text in NOT_MODELLED)]
    found += [
        "",
        "### Refused",
        "",
        "A scene with a part that its family does not take is refused by name. The families take:",
    ]
    found += ["", "| family | parts |", "| --- | --- |"]
    found += [f"| {family.name} | {', '.join(sorted(family.knows))} |" for family in families()]
    found += [
        "",
        "Position-based sheets also refuse `motion`, on both backends. "
        "A step size beyond the stability limit is refused with the limit (`--allow-unstable` runs it).",
    ]
    found += ["", "### One backend only", "", *(f"- {text}" for text in ONE_BACKEND)]
    return [*found, "", "### Not tested", "", *(f"- {text}" for text in NOT_TESTED)]
