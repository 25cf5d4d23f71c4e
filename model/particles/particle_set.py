"""The sets of particles that a scene may have."""

from softlab.model.particles.body_set import BodySet
from softlab.model.particles.fluid_set import FluidSet
from softlab.model.particles.tetrahedra_set import TetrahedraSet
from softlab.model.particles.world_set import WorldSet
from softlab.model.tables.parts import Grid

ParticleSet = BodySet | TetrahedraSet | FluidSet | WorldSet
Particles = Grid | ParticleSet  # a sheet (grid, cloth, mesh), or a set that looks like a sheet of one row
