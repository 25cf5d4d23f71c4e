"""Content of `softlab plan --gpus N`: who owns which rows, bodies or slabs, the messages, and the bound by the link."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from softlab.app.command.tables import number
from softlab.model.base.memory import readable
from softlab.model.core.sharing.bodies import Division
from softlab.model.core.sharing.decomposition import Decomposition
from softlab.model.core.sharing.partitions import Partitions
from softlab.model.domains.link import NVLINK, Link
from softlab.model.domains.partitioned import is_partitioned, partitions
from softlab.model.domains.shared_bodies import division, is_apart
from softlab.model.domains.shared_fluid import bytes_each
from softlab.model.domains.simulation import cut
from softlab.model.domains.slabs import Slabs, is_in_slabs, slabs_at_start
from softlab.model.scene.scene import Scene

LINES = 16  # of domains that are listed


def _more(count: int) -> list[str]:
    """Return the line that replaces the entries which are not listed."""
    return [f"  and {count - LINES} more"] if count > LINES else []


def _link(link: Link) -> dict[str, object]:
    """Return the object for `--json`."""
    return {"latency": link.latency, "bandwidth": link.bandwidth, "source": link.source}


def _adds(link: Link, seconds: float) -> str:
    """Return the line on the time that messages add to a step [s]."""
    return (
        f"  {link.name} ({1e6 * link.latency:g} us, {link.bandwidth / 1e9:g} GB/s; {link.source}) adds "
        f"{1e6 * seconds:.2g} us per step"
    )


@dataclass(frozen=True)
class SharedPlan:
    """A sheet on several GPUs. `mass_bytes`: of a mass's state, its position and velocity."""

    decomposition: Decomposition
    mass_bytes: int
    link: Link = NVLINK

    @property
    def message(self) -> int:
        """Bytes of an exchange, from a window to a neighbour, each way."""
        return self.decomposition.bytes_sent(self.mass_bytes)

    @property
    def bytes_per_step(self) -> float:
        """Bytes of a step, from a window to a neighbour, each way."""
        return self.message / self.decomposition.interval

    @property
    def exchange_seconds(self) -> float:
        """Time of an exchange by the link: both neighbours at once, both ways at once."""
        return self.link.seconds(self.message) if self.message else 0.0

    @property
    def step_seconds(self) -> float:
        """Time that exchanges add to a step."""
        return self.exchange_seconds / self.decomposition.interval

    @property
    def most_masses(self) -> float:
        """Masses/s at which messages take as long as a step: an upper bound for any number of GPUs."""
        decomposition = self.decomposition
        return decomposition.rows * decomposition.columns / self.step_seconds if self.step_seconds else float("inf")

    def as_dict(self) -> dict[str, object]:
        """Return the object for `--json`."""
        decomposition = self.decomposition
        return {
            "gpus": decomposition.count, "exchange_every": decomposition.interval, "halo_rows": decomposition.halo,
            "repeated_rows": decomposition.repeated - 1,
            "domains": [
                {"first_row": d.first, "end_row": d.end, "window_rows": d.window_rows} for d in decomposition.domains
            ],
            "bytes_per_exchange": self.message, "bytes_per_step": self.bytes_per_step,
            "link": _link(self.link),
            "exchange_seconds": self.exchange_seconds, "step_seconds": self.step_seconds,
            "most_masses_per_second": self.most_masses if self.message else None,
        }  # fmt: skip

    def lines(self) -> list[str]:
        """Return the lines for a person."""
        decomposition = self.decomposition
        lines = [
            f"shared by {decomposition.count} GPUs, by rows; halos of {decomposition.halo} rows, "
            f"exchanged {decomposition.schedule}"
        ]
        for domain in decomposition.domains[:LINES]:
            state = readable(domain.window_rows * decomposition.columns * self.mass_bytes)
            window = f"stores {domain.window_first} to {domain.window_end - 1} ({state} per state)"
            lines.append(f"  GPU {domain.number}: owns rows {domain.first} to {domain.end - 1}, {window}")
        lines += _more(decomposition.count)
        lines.append(f"  {100 * (decomposition.repeated - 1):.2g} % of the rows are computed twice")
        lines.append(
            f"  {readable(self.message)} to each neighbour per exchange, {readable(self.bytes_per_step)} per step, each way"
        )
        most = f"at most {number(self.most_masses / 1e9)} billion masses/s"
        lines.append(f"{_adds(self.link, self.step_seconds)}: {most}")
        return lines


@dataclass(frozen=True)
class BodiesPlan:
    """Bodies on several GPUs; `particle_bytes`: as `mass_bytes` of a sheet."""

    division: Division
    particle_bytes: int

    def as_dict(self) -> dict[str, object]:
        """Return the object for `--json`."""
        split = self.division
        return {
            "gpus": split.count, "balanced_by": split.counted, "balance": split.balance,
            "shares": [
                {
                    "first_body": s.first, "end_body": s.end, "parts": list(s.parts),
                    "particles": s.end_particle - s.first_particle, split.counted: s.weight,
                }
                for s in split.blocks
            ],
            "bytes_per_step": 0,
        }  # fmt: skip

    def lines(self) -> list[str]:
        """Return the lines for a person."""
        split = self.division
        lines = [
            f"shared by {split.count} GPUs, body by body, balanced by {split.counted}; no data is exchanged during a step"
        ]
        for block in split.blocks[:LINES]:
            bodies = (
                f"body {block.first}" if block.end == block.first + 1 else f"bodies {block.first} to {block.end - 1}"
            )
            names = block.parts if len(block.parts) < 4 else (block.parts[0], "...", block.parts[-1])
            particles = block.end_particle - block.first_particle
            amount = f"{number(particles)} particles ({readable(particles * self.particle_bytes)} per state)"
            if split.counted != "particles":
                amount = f"{number(block.weight)} {split.counted}, {amount}"
            lines.append(f"  GPU {block.number}: owns {bodies} ({', '.join(names)}), {amount}")
        lines += _more(split.count)
        fair = f"the largest part has {100 / (split.count * split.balance):.3g} % of the {split.counted}"
        return [*lines, f"  {fair}: at most {split.count * split.balance:.3g} times as fast as one"]


@dataclass(frozen=True)
class PartitionsPlan:
    """Meshes of bodies in partitions on several GPUs; `particle_bytes`: as `mass_bytes` of a sheet."""

    partitions: Partitions
    particle_bytes: int
    link: Link = NVLINK

    @property
    def message(self) -> int:
        """Bytes of the largest message of an exchange."""
        return self.partitions.most_sent * self.particle_bytes

    @property
    def step_seconds(self) -> float:
        """Time that exchanges add to a step, by the link: all neighbours at once, both ways at once."""
        return self.partitions.mesh.exchanges * self.link.seconds(self.message)

    def as_dict(self) -> dict[str, object]:
        """Return the object for `--json`."""
        all_partitions, mesh = self.partitions, self.partitions.mesh
        return {
            "gpus": all_partitions.count, "exchanges_per_step": mesh.exchanges, "balance": all_partitions.balance,
            "repeated_particles": all_partitions.repeated - 1,
            "shares": [
                {"particles": len(p.owned), "window_particles": len(p.particles), f"window_{mesh.counted}": len(p.elements)}
                for p in all_partitions.parts
            ],
            "bytes_per_exchange": self.message, "bytes_per_step": self.message * mesh.exchanges,
            "link": _link(self.link),
            "step_seconds": self.step_seconds,
        }  # fmt: skip

    def lines(self) -> list[str]:
        """Return the lines for a person."""
        all_partitions, mesh = self.partitions, self.partitions.mesh
        times = "once" if mesh.exchanges == 1 else f"{mesh.exchanges} times"
        lines = [
            f"shared by {all_partitions.count} GPUs, by partitions of the mesh; halos are exchanged {times} per step"
        ]
        for part in all_partitions.parts[:LINES]:
            window = f"stores {number(len(part.particles))} and {number(len(part.elements))} of {number(mesh.elements)}"
            lines.append(f"  GPU {part.number}: owns {number(len(part.owned))} particles, {window} {mesh.counted}")
        lines += _more(all_partitions.count)
        return [
            *lines,
            f"  {100 * (all_partitions.repeated - 1):.3g} % of the particles are computed twice: at most "
            f"{all_partitions.count * all_partitions.balance:.3g} times as fast as one",
            f"  {readable(self.message)} to a neighbour per exchange at most, "
            f"{readable(self.message * mesh.exchanges)} per step",
            _adds(self.link, self.step_seconds),
        ]


@dataclass(frozen=True)
class SlabsPlan:
    """A fluid on several GPUs, at its start. `counts` (slabs, 3): number of particles that each owns, stores, and sends
    per substep; `particle_bytes`: as `mass_bytes` of a sheet."""

    slabs: Slabs
    counts: np.ndarray
    substeps: int
    particle_bytes: int
    sent_bytes: int

    @property
    def repeated(self) -> float:
        """Computed particles that another window owns, relative to all particles."""
        owned, stored, _ = self.counts.sum(axis=0)
        return float(stored / owned - 1)

    @property
    def bytes_per_step(self) -> int:
        """Bytes that all GPUs together send per step."""
        return int(self.counts[:, 2].sum()) * self.sent_bytes * self.substeps

    @property
    def gain(self) -> float:
        """Upper bound of the speedup: all particles divided by those that the largest slab computes."""
        return float(self.counts[:, 0].sum() / self.counts[:, 1].max())

    def as_dict(self) -> dict[str, object]:
        """Return the object for `--json`."""
        return {
            "gpus": self.slabs.count, "axis": "xyz"[self.slabs.axis], "halo": self.slabs.halo,
            "bounds": self.slabs.bounds.tolist(), "repeated_particles": self.repeated, "most_gain": self.gain,
            "shares": [
                {"particles": int(owned), "window_particles": int(stored), "sent_particles": int(sent)}
                for owned, stored, sent in self.counts
            ],
            "bytes_per_step": self.bytes_per_step,
        }  # fmt: skip

    def lines(self) -> list[str]:
        """Return the lines for a person."""
        slabs = self.slabs
        axis = "xyz"[slabs.axis]
        lines = [
            f"shared by {slabs.count} GPUs, by slabs along {axis} with as many particles each; halos of {slabs.halo:.3g} m, "
            "exchanged every substep; at the start:"
        ]
        for slab, (owned, stored, _) in enumerate(self.counts[:LINES]):
            low, high = slabs.ends(slab)
            place = [f"from {low:.3g} m" * (slab > 0), f"to {high:.3g} m" * (slab + 1 < slabs.count)]
            window = f"stores {number(stored)} ({readable(int(stored) * self.particle_bytes)} per state)"
            lines.append(
                f"  GPU {slab}: owns {number(owned)} particles {' '.join(filter(None, place)) or 'all'}, {window}"
            )
        lines += _more(slabs.count)
        return [
            *lines,
            f"  {100 * self.repeated:.2g} % of particles are computed twice: at most {self.gain:.3g} times as fast as one",
            f"  {readable(self.bytes_per_step)} per step are sent in all, through the host",
        ]


def _slabs_plan(scene: Scene, gpus: int, exchange_every: int | None, item: int, particle_bytes: int) -> SlabsPlan:
    slabs = slabs_at_start(scene, gpus, exchange_every, "--gpus")
    along = scene.fluid_set.position[:, slabs.axis]
    owned, counts = [slabs.owned(along, slab) for slab in range(gpus)], np.zeros((gpus, 3), np.int64)
    for slab in range(gpus):
        stored = slabs.contained(along, slab)
        counts[slab, :2] = owned[slab].sum(), stored.sum()
        counts[:, 2] += [(of_other & stored).sum() if other != slab else 0 for other, of_other in enumerate(owned)]
    return SlabsPlan(slabs, counts, scene.method.substeps, particle_bytes, bytes_each(item, scene.dimensions))


def shared_plan(
    scene: Scene, gpus: int, exchange_every: int | None, item: int
) -> SharedPlan | BodiesPlan | PartitionsPlan | SlabsPlan:
    """Return the plan of a scene on so many GPUs; `item`: bytes of a scalar. Raises SceneError."""
    numbers = 2 if scene.dimensions == 2 else 4  # of a position: pairs in a plane, quads in space
    if is_in_slabs(scene):
        return _slabs_plan(scene, gpus, exchange_every, item, 2 * numbers * item)
    if is_partitioned(scene, gpus):
        return PartitionsPlan(partitions(scene, gpus, exchange_every, "--gpus"), 2 * numbers * item)
    if is_apart(scene):
        return BodiesPlan(division(scene, gpus, exchange_every, "--gpus"), 2 * numbers * item)
    return SharedPlan(cut(scene, gpus, exchange_every, "--gpus"), 2 * numbers * item)
