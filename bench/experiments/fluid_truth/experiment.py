"""`softlab fluids --truth`: the error of every setting of scenes.py by laws.py, and the time of a frame of it.

Frames are sampled in turn from the state whose error was computed. `--peers` adds other programs on the same scenes. A
group is a kind of scene on a backend. Peers are in the group of the lab's settings, as entries of their own; one that
is not installed, or cannot run the scene, leaves its reason.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Protocol

from softlab.app.driver import open_simulation
from softlab.bench.experiments.fluid_truth.laws import judged
from softlab.bench.experiments.fluid_truth.scenes import DAM, TANK, Setting, settings
from softlab.bench.measure.costs_timing import FULL, QUICK, RATIO, SECONDS, Effort, Measures, Record, in_turn
from softlab.bench.measure.declaration import Option
from softlab.bench.measure.experiment import host_of
from softlab.bench.measure.items import Group, cost_sources
from softlab.bench.measure.timing import Subject, prepare
from softlab.bench.store.database import Store
from softlab.bench.store.results import configuration
from softlab.bench.store.schema import Description
from softlab.model.base.components import component
from softlab.model.base.errors import SoftlabError
from softlab.model.core.build import build
from softlab.model.core.simulation import State
from softlab.model.scene.scene import Scene

FINDING = "fluid: "  # prefix of `finding`, followed by the kind
BESIDE = "softlab.bench.peers.fluids.beside"  # SPlisHSPlasH
LABELS = {f"splishsplash_{method.lower()}": f"SPlisHSPlasH {method}" for method in ("DFSPH", "PBF")}  # name -> label
PEERS = {TANK: ("DFSPH",), DAM: ("DFSPH", "PBF")}  # its methods by kind; its PBF takes seconds per frame in the tank


class FluidPeer(Protocol):
    """Another program that runs fluids (bench/peers/base.py)."""

    name: str
    backend: str

    def available(self) -> tuple[bool, str]:
        """Return (whether it is installed, its version or what to install)."""


@dataclass(frozen=True)
class Run:
    """A setting, run by softlab (`peer` None) or by another program, on that many CPU `threads`."""

    setting: Setting
    backend: str
    peer: FluidPeer | None = None
    threads: str | int = "1x"

    @property
    def description(self) -> Description:
        name = None if self.peer is None else self.peer.name
        host = host_of(self.backend, self.threads)
        fields = configuration(self.setting.scene, backend=self.backend, peer=name, **host)
        return fields | {"finding": FINDING + self.setting.kind}


def groups(store: Store, backends: Sequence[str], quick: bool, peers: bool = False) -> list[Group]:
    """Return the groups: a kind of scene on a backend, whose errors are computed and whose times are sampled in turn."""
    all_groups = []
    some = list(settings(quick))
    for backend in backends:
        for kind in dict.fromkeys(one.kind for one in some):
            of_kind = [one for one in some if one.kind == kind]
            runs = [Run(one, backend) for one in of_kind]
            beside = [one for one in of_kind if one.beside]
            if peers and beside:
                others = [component(f"{BESIDE}:peer_of", "--peers")(method) for method in PEERS.get(kind, ())]
                runs += [Run(beside[0], backend, peer) for peer in others if peer.backend == backend]
            process = Path(__file__).parents[2].glob("peers/fluids/splishsplash_process.py")
            sources = cost_sources(backend, [*sorted(Path(__file__).parent.glob("*.py")), *process])
            descriptions = tuple(run.description for run in runs)
            measure = partial(_measured, runs, descriptions, QUICK if quick else FULL)
            all_groups.append(Group(f"{kind}, {backend}", descriptions, sources, measure, len(runs)))
    return all_groups


BESIDE_PEERS = Option("--peers", "With --truth or --rest: also measure other programs (SPlisHSPlasH).", bool)


def _measured(
    runs: Sequence[Run], descriptions: Sequence[Description], effort: Effort, record: Record
) -> list[Measures]:
    measures: list[Measures] = [{} for _ in runs]
    with ExitStack() as stack:
        ready: list[tuple[int, Subject]] = []
        for number, (run, one) in enumerate(zip(runs, descriptions, strict=True)):
            scene = run.setting.scene
            try:
                simulation = stack.enter_context(opened(run, stack))
                measures[number] |= judged(simulation, scene, run.setting.kind)
                subject = Subject(simulation, one, start=_state(simulation, scene))
                ready.append((number, prepare(subject, effort.seconds, effort.most)))
            except SoftlabError as reason:  # diverged, not installed, or refused
                measures[number] |= {name: (None, "", str(reason)) for name in (SECONDS, RATIO)}
        timed = in_turn(record, [subject for _, subject in ready], effort.repeats) if ready else []
    for (number, _), numbers in zip(ready, timed, strict=True):
        measures[number] |= numbers
    return measures


def opened(run: Run, stack: ExitStack) -> Any:
    """Open a setting as a context manager. Raises SoftlabError."""
    scene = run.setting.scene
    if run.peer is None:
        return open_simulation(scene, run.backend, threads=run.threads)
    threads = host_of("cpu", run.threads)["threads"]
    return component(f"{BESIDE}:opened_peer", "--peers")(run.peer, scene, threads, stack)


def _state(simulation: Any, scene: Scene) -> State:
    """Return the state to sample from."""
    if hasattr(simulation, "state"):
        state: State = simulation.state()
        return state
    body = build(scene)
    return State(simulation.read("position"), simulation.read("velocity"), body.inverse_mass, 0.0, 0)
