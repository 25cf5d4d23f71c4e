"""Mistakes between parts of a scene: members of a world, windows of several ranks or GPUs, a fluid and its solids."""

from __future__ import annotations

from .mistake import mistakes_of

NEAR = "test_near.py::test_states_are_the_references"
WORLD = f"{NEAR}[world-jelly-on-a-block-float64] {NEAR}[world-two-on-a-pinned-block-float64] {NEAR}[world-jelly-on-a-cloth-float64] {NEAR}[world-all-float64]"
FLUID = "test_shares.py::test_shares_have_the_bits_of_one[dam-in-float64-3]"
BAR = "test_shares.py::test_shares_have_the_bits_of_one[bar-3]"

WORLDS = mistakes_of({
    "cpu_backend/world/joined.py": {
        WORLD: {
            "contacts between members begin where the particles are, not where they were (cpu)": ("self._transfers.take(self._bands, before, slots, stride, first, self.before)", "self._transfers.take(self._bands, position, slots, stride, first, self.before)"),
        },
    },
    "gpu_backend/world/joined.py": {
        "simulator/test_simulated_bits.py::test_kernels_have_the_bits_of_the_cpu[world-jelly-on-a-block-by-vertices-float32]": {
            "a member is read from the buffer of the step before (gpu)": ("self._transfers.take[launch](member.position[member._current], indices", "self._transfers.take[launch](member.position[1 - member._current], indices"),
            "a member's inertia does not go with what pushed it (gpu)": ("self._transfers.carry[launch](*there, member.inertial)", "self._transfers.give[launch](*there)"),
        },
    },
    "gpu_backend/world/solver.py": {
        "simulator/test_simulated_bits.py::test_kernels_have_the_bits_of_the_cpu[world-jelly-on-a-block-by-vertices-float32]": {
            "contacts between members are projected in the last iteration alone (gpu)": ("member.iterate(iteration)\n            self._project()", "member.iterate(iteration)\n        self._project()"),
        },
    },
    "model/world/meeting.py": {
        WORLD: {
            "members' groups have the same numbers": ('shifted("body", group)', 'whole("body")'),
            "triangles of later members have the first one's corners": ('shifted("triangles", vertex)', 'whole("triangles")'),
            "a ball is as thin as a triangle": ("np.where(np.isnan(radius), distance, radius + distance / 2)", "np.where(np.isnan(radius), distance, distance)"),
        },
    },
    "model/world/simulation.py": {
        "test_world_cpu.py::test_a_poke_pushes_its_particle_and_the_member_that_it_is_of[tetrahedra] test_world_cpu.py::test_a_bad_particle_is_told_by_its_number_in_the_world": {
            "a poke of a later member pushes another of its particles": ("poked = particle - place.start if", "poked = particle if"),
            "a diverged particle has its number in its member": ("return self.slices[name].start + bad", "return bad"),
        },
    },
})  # fmt: skip

DOMAINS = mistakes_of({
    "model/domains/shared_fluid.py": {
        FLUID: {
            "what left a slab is owned by two": ("owned[:] = False", "owned[:] = owned"),
            "slabs are not sent what came into their halo": ("some = np.flatnonzero(owned & slabs.contained(along, slab))", "some = np.flatnonzero(owned & slabs.owned(along, slab))"),
        },
    },
    "model/domains/partitioned.py": {
        BAR: {
            "partitions exchange at the end of a step, not of a substep": ("self._run_each(number, 1)\n            self.exchange.post()\n            self.exchange.wait()", "self._run_each(number, 1)\n        self.exchange.post()\n        self.exchange.wait()"),
        },
        "test_partitions.py::test_a_bad_vertex_is_told_by_its_number_in_the_whole": {
            "a diverged vertex has its number in its partition": ("else int(part.particles[bad])", "else int(bad)"),
        },
    },
    "model/domains/shared_bodies.py": {
        "test_shares.py::test_shares_have_the_bits_of_one[bodies-3] test_shared_bodies.py::test_what_is_done_to_bodies_reaches_their_shares": {
            "clusters are gathered in the order of blocks": ("whole[self._clusters] = gathered", "whole[:] = gathered"),
        },
    },
    "model/domains/windows.py": {
        "test_shares.py::test_shares_have_the_bits_of_one[grid-by-stages-2]": {"windows begin each run at step 0": ("window.step = first\n", "window.step = 0\n")},
    },
    "model/core/sharing/decomposition.py": {
        "test_decomposition.py": {
            "a border is sent to the row above its own": ("lower.first - lower.window_first, lower.first - upper.window_first, up", "lower.first - lower.window_first, lower.first - upper.window_first - 1, up"),
        },
    },
    "gpu_backend/domains/units.py": {
        "simulator/test_simulated_shared_bodies.py::test_a_mesh_in_partitions_has_the_bits_of_the_cpu[xpbd-sleeping0-float32]": {
            "a halo is read from the buffer of the step before (gpu)": ("return self._both[self._window._current]", "return self._both[1 - self._window._current]"),
        },
    },
    "gpu_backend/domains/partitions.py": {
        "simulator/test_simulated_shared_bodies.py::test_a_mesh_in_partitions_has_the_bits_of_the_cpu[xpbd-sleeping0-float64]": {
            "only the first unit of a particle is sent (gpu)": ("(row * places[:, None] + np.arange(row)).ravel()", "(row * places[:, None] + 0 * np.arange(row)).ravel()"),
        },
    },
    "gpu_backend/domains/kernels.py": {
        "simulator/test_simulated_domains.py::test_two_windows_have_the_bits_of_the_cpu[lab-flags]": {
            "an exchange is taken from the half of the one before (gpu)": ("half = np.int32((taken[0] & 1) * 2 * count)", "half = np.int32(((taken[0] + 1) & 1) * 2 * count)"),
            "a block does not count what it has sent (gpu)": ("sent[block] = number", "sent[block] = sent[block]"),
        },
    },
})  # fmt: skip

SHARING = (*WORLDS, *DOMAINS)
