"""A world on CPU threads: members of several families, stage by stage, and contacts between them."""

from __future__ import annotations

import numba

from softlab.cpu_backend.contact.surfaces import SurfaceContacts
from softlab.cpu_backend.core.processor import processor_name
from softlab.cpu_backend.core.simulation import ParticlesSimulation, chosen_kernel
from softlab.cpu_backend.core.threads import thread_count
from softlab.cpu_backend.fluid.among_solids import FluidAmongSolids
from softlab.cpu_backend.world.joined import Joined
from softlab.model.base.components import named
from softlab.model.core.families import family_of, scene_plan
from softlab.model.core.plan import Executor
from softlab.model.core.simulation import Options, Simulation
from softlab.model.scene.scene import Scene
from softlab.model.world.meeting import MEMBERS_MEETING, cross_surface
from softlab.model.world.plan import coupled
from softlab.model.world.simulation import STAGES, WorldSimulation
from softlab.model.world.solids import solids_of


class World(WorldSimulation):
    """A world on CPU threads (model/world/simulation.py). `threads`: `1x`, `2x`, `4x` or a number."""

    backend = "cpu"

    def __init__(self, scene: Scene, options: Options, threads: str | int = "1x"):
        super().__init__(scene, options)
        self.threads, self.device = thread_count(threads), processor_name()
        self.plan, self.kernel = scene_plan(scene, options.live), chosen_kernel(options.kernel, "a world", (STAGES,))
        try:
            self._open_members(STAGES)
            if coupled(self.scene):
                self._join()
            self._executor = Executor(self.plan, self._all_stages())
            self.reset()
        except BaseException:
            self.close()
            raise

    def _open(self, scene: Scene, options: Options) -> Simulation:
        if scene.fluids:  # a fluid is opened last
            return self._open_fluid(scene, options)
        return named(family_of(scene).solvers[self.backend])(scene, options, self.threads)

    def _open_fluid(self, scene: Scene, options: Options) -> Simulation:
        """Open the fluid among the solids of the other members, whose particles it reads and writes back."""
        solids, weights = solids_of(self.scene), self.body.inverse_mass * self.scene.grid.mass
        members: dict[str, ParticlesSimulation] = self.members  # type: ignore[assignment]
        bands = max(member._bands for member in members.values())
        places = Joined(solids.particles, members, self.slices, weights, bands)
        return FluidAmongSolids(scene, options, self.threads, solids.samples, places)

    def _join(self) -> None:
        """Allocate the particles in contact."""
        members: dict[str, ParticlesSimulation] = self.members  # type: ignore[assignment]
        bands = max(member._bands for member in members.values())
        weights, meeting = self.body.inverse_mass * self.scene.grid.mass, cross_surface(self.scene)
        variant = self.real, self.options.math
        self.joined = Joined(meeting.particles, members, self.slices, weights, bands)
        self.contacts = SurfaceContacts(self.scene, *variant, bands, self.joined.weights, MEMBERS_MEETING)

    def _run(self, steps: int) -> None:
        numba.set_num_threads(self.threads)
        super()._run(steps)
