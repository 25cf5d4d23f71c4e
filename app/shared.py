"""Scenes on several GPUs or processes: options, opening, and the entries of a run's report."""

from __future__ import annotations

from pathlib import Path

from softlab.model.base.components import component
from softlab.model.base.errors import SceneError
from softlab.model.core.options import Options
from softlab.model.core.simulation import Simulation
from softlab.model.domains.launched import launched_ranks
from softlab.model.domains.partitioned import PartitionedBodies, is_partitioned, partitions
from softlab.model.domains.shared_bodies import SharedBodies, bodies_of, division, is_apart
from softlab.model.domains.shared_fluid import SharedFluid
from softlab.model.domains.simulation import DecomposedSimulation, cut, stencil_of
from softlab.model.domains.slabs import fluid_halo_of, is_in_slabs, slabs_at_start
from softlab.model.scene.scene import Scene
from softlab.model.tables.motion import RELEASE

LINKS = {  # of GPUs: the class that opens a sheet which they share
    "flags": "softlab.gpu_backend.domains.flags:FlagSimulation",
    "nccl": "softlab.gpu_backend.domains.nccl:NcclSimulation",
}
USUAL_LINK = "flags"
BODIES = "softlab.gpu_backend.domains.bodies:GpuBodies"
PARTITIONS = "softlab.gpu_backend.domains.partitions:GpuPartitions"
FLUID = "softlab.gpu_backend.domains.fluid:GpuFluid"
NO_LINK = {  # of those that are shared in one way alone
    BODIES: "bodies send nothing",
    PARTITIONS: "partitions of a mesh are read from the neighbours' memory",
    FLUID: "a fluid is exchanged through the host",
}


def check_sharing(backend: str, gpus: int, ranks: int, link: str | None) -> None:
    """Raise SceneError for invalid or contradictory options of sharing; `link` None: not given."""
    if gpus < 1 or ranks < 1:
        name, value = ("--gpus", gpus) if gpus < 1 else ("--ranks", ranks)
        raise SceneError(name, value, "must be a whole number, at least 1")
    if link == "peer":
        raise SceneError("--link", link, "was removed; use flags, which is faster, or nccl, which also joins hosts")
    if link is not None and link not in LINKS:
        raise SceneError("--link", link, f"must be one of {', '.join(LINKS)}")
    if gpus > 1 and ranks > 1:
        raise SceneError(
            "--gpus", gpus, "--gpus and --ranks are mutually exclusive; use --ranks on CPUs, --gpus with --backend gpu"
        )
    if gpus > 1 and backend != "gpu":
        raise SceneError("--gpus", gpus, "applies to --backend gpu; add it, or use --ranks on CPUs")
    if ranks > 1 and backend != "cpu":
        raise SceneError(
            "--ranks", ranks, "applies to --backend cpu; on GPUs use --gpus (with --link nccl one process each)"
        )


def check_asked(backend: str, gpus: int, ranks: int, exchange_every: int | None, link: str | None) -> None:
    """Call check_sharing, and refuse options that need several GPUs or processes if there is only one."""
    check_sharing(backend, gpus, ranks, link)
    alone = gpus == 1 and ranks == 1 and launched_ranks() == 1
    for option, value in (("--link", link), ("--exchange-every", exchange_every)):
        if value is not None and alone:
            raise SceneError(
                option, value, "applies to a scene shared by several GPUs or processes; add --gpus or --ranks"
            )


def _refuse_releases(scene: Scene) -> None:
    if scene.phases:
        reason = "releases pins, which is not supported on several GPUs or processes; run the scene on one"
        raise SceneError(f"{scene.name_of(RELEASE)}.kind", RELEASE, reason)


def check_shareable(scene: Scene, count: int, option: str) -> None:
    """Raise SceneError for a scene that cannot be shared at all."""
    _refuse_releases(scene)
    if is_apart(scene):
        bodies_of(scene)
    elif is_in_slabs(scene):
        fluid_halo_of(scene)
    else:
        stencil_of(scene, count, option)


def check_cut(scene: Scene, count: int, steps: int | None, link: str | None, option: str) -> None:
    """Raise SceneError if `count` GPUs or processes cannot share the scene, before anything is opened or started.

    `steps` between two exchanges and `link` are None if not given.
    """
    _refuse_releases(scene)
    opener = _opener(scene, count)
    {None: cut, BODIES: division, PARTITIONS: partitions, FLUID: slabs_at_start}[opener](scene, count, steps, option)
    _check_link(opener, link)


def _opener(scene: Scene, count: int) -> str | None:
    """Return the class that opens a scene shared without a link, or None for a sheet, which is shared by a link."""
    if is_partitioned(scene, count):
        return PARTITIONS
    return BODIES if is_apart(scene) else FLUID if is_in_slabs(scene) else None


def _check_link(opener: str | None, link: str | None) -> None:
    """Raise SceneError for a `link` that `opener` does not take. `link` None: none was requested."""
    if opener is not None and link is not None:
        reason = f"applies to a sheet that is shared by its rows: {NO_LINK[opener]}; leave it out"
        raise SceneError("--link", link, reason)


def open_shared(
    scene: Scene,
    backend: str,
    options: Options,
    threads: str | int,
    gpus: int,
    ranks: int,
    exchange_every: int | None,
    link: str,
) -> Simulation:
    """Open the scene on several GPUs or processes; see app/driver.py. Raises SceneError, BackendUnavailable."""
    check_sharing(backend, gpus, ranks, link)
    _refuse_releases(scene)
    if backend == "cpu":
        of_ranks = component("softlab.cpu_backend.domains.mpi:MpiRanks", "--ranks")(ranks)
        on_ranks = component("softlab.cpu_backend.domains.ranks:on_ranks", "--ranks")
        together: Simulation = on_ranks(scene, options, of_ranks, threads, exchange_every)
        return together
    opener = _opener(scene, gpus)
    _check_link(opener, None if link == USUAL_LINK else link)
    opened: Simulation = component(opener or LINKS[link], "--gpus")(scene, options, gpus, exchange_every)
    return opened


def sharing_report(simulation: Simulation) -> dict[str, object]:
    """Return the entries of a run's report about the sharing of its scene; empty if it is not shared."""
    name = "ranks" if simulation.backend == "cpu" else "gpus"
    if isinstance(simulation, SharedBodies):
        split = simulation.division
        return {
            name: split.count,
            "bodies_each": [block.end - block.first for block in split.blocks],
            "balance": split.balance,
        }
    if isinstance(simulation, SharedFluid):
        owned, stored = simulation.particle_counts().T
        return {
            name: len(owned),
            "particles_each": owned.tolist(),
            "balance": float(owned.mean() / owned.max()),
            "repeated_particles": float(stored.sum() / owned.sum() - 1),
        }
    if isinstance(simulation, PartitionedBodies):
        parts = simulation.partitions
        return {
            name: parts.count,
            "exchanges_per_step": parts.mesh.exchanges,
            "particles_each": [len(part.owned) for part in parts.parts],
            "repeated_particles": parts.repeated - 1,
            "balance": parts.balance,
        }
    if not isinstance(simulation, DecomposedSimulation):
        return {}
    cut = simulation.decomposition
    return {
        name: cut.count,
        "exchange_every": cut.interval,
        "rows_each": cut.least_rows,
        "repeated_rows": cut.repeated - 1,
    }


def check_shared(processes: int, render: Path | None, export: str | None) -> None:
    """Raise SceneError for output that a run of several processes does not write: clips, which step while drawing."""
    if processes == 1:
        return
    if render and render.suffix.lower() == ".mp4":
        raise SceneError("--render", str(render), "is not supported with several processes; use --ranks 1")
    if export:
        raise SceneError("--export", export, "is not supported with several processes; use --ranks 1")
