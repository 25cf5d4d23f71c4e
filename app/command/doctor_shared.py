"""Findings of `softlab doctor` about several GPUs or processes: requirements of each kind of communication."""

from __future__ import annotations

from importlib.util import find_spec

from softlab.app.command.findings import Finding
from softlab.model.base.components import component
from softlab.model.base.errors import BackendUnavailable
from softlab.model.domains.processes import INSTALL, mpi_installed, mpiexec


def gpus_together() -> Finding:
    """Return how GPUs are linked, for `--gpus N`."""
    from softlab.gpu_backend.core.device import gpu_available, simulated

    name, hint = "several gpus", "SOFTLAB_SHARE_GPU=1 lets windows alternate on one GPU, to test --gpus 2"
    works, _ = gpu_available()
    if not works:
        return Finding(name, False, "no GPU was found, see gpu", "on CPUs use softlab run --ranks N")
    if simulated():
        return Finding(name, True, "in the simulator windows alternate on its one device")
    try:
        links = component("softlab.gpu_backend.domains.links:find_links", "--gpus")()
    except BackendUnavailable as missing:
        return Finding(name, False, missing.missing, missing.remedy)
    except ImportError:
        return Finding(name, False, "the GPUs' links are unknown: NVML is not installed", "pip install nvidia-ml-py")
    if links.count < 2:
        return Finding(name, False, str(links), hint)
    if links.apart:
        return Finding(name, False, str(links), "softlab run --link nccl exchanges through NCCL between those")
    return Finding(name, True, str(links))


def ranks_of_mpi() -> Finding:
    """Return the finding for `--ranks N`, and for `--link nccl`."""
    try:
        launcher = mpiexec()
        mpi_installed()
    except BackendUnavailable as error:
        return Finding("processes (mpi)", False, error.missing, error.remedy)
    return Finding("processes (mpi)", True, f"softlab run --ranks N, by {launcher}")


def gpus_by_nccl() -> Finding:
    """Return the finding for `--link nccl`."""
    name = "several gpus by nccl"
    if find_spec("nccl") is None:
        also = f"for several processes also {INSTALL}"
        return Finding(name, False, "nccl4py is not installed", f'pip install "nccl4py[cu13]"; {also}')
    return Finding(name, True, "nccl4py is installed; softlab run --gpus N --link nccl")
