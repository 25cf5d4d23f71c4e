"""The sets of particles that a scene without a sheet may have."""

from softlab.model.particles.body_set import BodySet
from softlab.model.particles.fluid_set import FluidSet
from softlab.model.particles.tetrahedra_set import TetrahedraSet
from softlab.model.particles.world_set import WorldSet

ParticleSet = BodySet | TetrahedraSet | FluidSet | WorldSet
