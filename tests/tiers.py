"""What runs by default, how, and what is for `pytest --thorough` alone; for `--rest` alone: tests/over_a_second.py."""

from __future__ import annotations


def table(text: str) -> dict[str, str]:
    """{file: patterns} of lines `file pattern pattern ...`; # begins a comment."""
    found: dict[str, str] = {}
    file = ""
    for line in text.splitlines():
        first, *rest = line.partition("#")[0].split() or [""]
        if first and not line[0].isspace():
            file, first = first, ""
        if file and (first or rest):
            found[file] = " ".join([found.get(file, ""), first, *rest]).strip()
    return found


# Tests run by default whose CPU kernels are compiled: of what only machine code does, or too long for anything else. In all
# others they run as plain Python (cpu_backend/core/plain.py), whose bits are the same. Tables: file -> patterns of tests'
# names.
COMPILED = {
    "test_advise_tetrahedra.py": "test_what_is_advised* test_stiff_bars*",  # seconds of motion
    "test_compiled.py": "*", "test_subnormals.py": "*", "test_bar.py": "test_springs_are_a_chain* test_tetrahedra_are*",
    "test_stability.py": "test_the_measured_edge*",
    "test_cpu_kernels.py": "*",  # wide and tall grids, threads that wait for each other, another threading layer
    "test_teams.py": "test_members*",  # threads at the same time, which plain Python does not order
    "test_kernel_sweep.py": "test_arithmetic_rates*",
    "test_voxel_accuracy.py": "*", "test_resting_skins.py": "*",  # statics, seconds of motion
    "test_xpbd_cpu_reference.py": "test_fast_math*",
    "test_tetrahedra_meshes.py": "test_a_swing*", "test_damping_load.py": "test_weight* test_a_run_notes_a_sag*",
    "test_newton.py": "*",  # statics take hundreds of steps
    "test_newton_order.py": "test_orders* test_a_swing* test_a_bar*",
    "test_findings_costs.py": "test_a_wrong_answer*",  # repeats in `fast` math, whose bits are those of machine code
    "test_kernel_keys.py": "test_a_distance_field*",  # plain Python makes no calls of compiled functions to record
    "test_kernel_cache.py": "*", "test_rotation.py": "*",  # machine code itself, a hundred thousand matrices
    "test_tetrahedra_cpu.py": "test_b21*", "test_hard_tetrahedra.py": "test_the_laws*",  # seconds of motion
    "test_hard_fluids.py": "test_the_laws*",
    "test_friction_on_colliders.py": "*", "test_surface_contacts.py": "test_four_sweeps*",  # a second of motion
    "test_kinematic.py": "test_an_end* test_both_ends*", "test_matter.py": "test_two_halves* test_every_solver*",  # statics
    "test_attachments.py": "test_a_body_on_soft*", "test_cloth_beside.py": "test_the_weight* test_a_box_slides*",
    "test_newton_3287.py": "test_tilted*",
    "test_accuracy.py": "*", "test_accuracy_s6.py": "*", "test_accuracy_xpbd.py": "*",
    "test_iterations.py": "*",  # to the end
    "test_laws_fast.py": "*",  # machine code itself
}  # fmt: skip

# Tests for --thorough alone: dear, and of what others hold too, on a smaller scene, by another way, or for another value. A
# file, then patterns of tests' names; further lines of a file begin with a space.
ONLY_THOROUGH = table("""
test_laws_fast.py *
test_mpi.py test_processes* test_two* test_a_div* test_bad_input*arguments[2-6]*  # processes, seconds each
test_shares.py *hundreds*
test_shared_fluid.py *too_thin?averaged* *too_thin?smoothed*
test_fluid_advice.py test_a_scene_is_ablated* test_an_answer_is_run*
test_fluid_physics.py *
test_archimedes.py *
test_fluid_vessels.py test_what_a_cup* test_a_splash*
test_compiled.py *fluid*
# five to twenty seconds each, of what siblings hold for another value, shape or solver
test_advise_tetrahedra.py test_an_answer_in_words*
test_bodies_hard.py test_a_soft_body_finds*plane-float32?
test_surface_contacts.py test_cubes_that_collide*
test_kinematic.py test_an_end_that_is_driven*
test_attachments.py test_two_free_bodies*
test_stability_figures.py *draw_stiffness?
test_labbook.py *keeps_its_length*  # draws every figure of the committed measurements
# ten to twenty seconds each, most of them of compiling; what they run is held against its judge by default, too
test_bars_of_peers.py test_error_stands*
test_surface_contacts.py test_a_cube_on_a_cube*
test_world_rest.py test_a_brick* test_a_jelly*
test_bodies_hard.py test_a_soft_body_finds*axis-float32?
test_kinematic.py test_both_ends*
test_hard_bodies.py test_the_laws*B17?heavy*
test_attachments.py test_a_step_is_backward*vbd-0.001?
test_simulated_newton.py test_fast_math_takes*
# CPU machine code: each solver keeps a case or two, of the fused kernel and the most parts
test_compiled.py *cloth,?rk4* *cloth,?implicit* *xpbd,?jacobi* *xpbd,?averaged* *lattices* *meet?in?stages*
    *meets?itself* *give?way* *cloth?in?stages* *xpbd?in?stages* *mesh?in?stages* *rk4?in?stages*
    *blocks?in?stages*
    *body?on?a?field* test_fast_math*cloth? test_fast_math*jelly* test_fast_math*mesh?
test_cpu_reference.py *published*rk4* *published*velocity-verlet*
test_xpbd_cpu_reference.py test_fast_math*
test_cpu_assembly.py *fused-float64-fast*
test_cloth_assembly.py *
test_xpbd_assembly.py *
test_implicit.py test_float32_stops*
    test_energy_falls*

test_peers_compared.py test_what_approaches*
test_peers_sheets.py test_iterations_approach*
test_no_trace.py *velocity-verlet-parts2*float64* *lab-parts0*float64?
# orders and limits: with a force fewer, or by the reference
test_cloth_orders.py test_contacts_do_not* test_orders*all-cpu? test_holds*dampers?along* test_holds*rk4*
    *along?springs-cpu? test_converged_reference*wind test_orders*along?springs-reference?
    test_holds*velocity-verlet-springs-cpu?
test_orders.py test_linear_lattice_of_the_unstable* *taylor-counts* *explicit-euler-counts*
    test_linear_lattice*cpu-lab* test_linear_lattice*cpu-semi*
test_physics_conservation.py *elastic_pendulum*cpu-lab* *elastic_pendulum*cpu-semi*
test_physics_hard.py *B1?hanging-lab?
test_reference.py test_rk4*-2.0?
test_shapes.py *octopus-4* *letters*
test_stability.py test_the_measured_edge*rk4* test_the_measured_edge*taylor*
test_xpbd_laws.py test_small_steps_rope* test_tethers*
test_xpbd_reference_sheets.py test_first_order*along*
test_rebound.py test_bodies_that_meet*
test_surfaces3d.py *closed*mesh2*
# processes that import the whole lab, and time with it
test_pools.py test_workers_by_dask test_workers_by_slurm test_a_dask_worker* test_two_real_workers*
test_sweep_on_many.py *nothing?2? *nothing?3?
# scenes of the catalogue, and cases that break solvers
test_bodies_catalogue.py test_bodies_fall*plastic? test_bodies_fall*jelly-drop? test_bodies_fall*soft-pile?
    test_bodies_fall*soft-rain?
    test_bodies_fall*two-worlds? test_bodies_fall*two-worlds-moon?
test_hard_bodies.py test_the_laws*S7?16* test_the_laws*B20* test_the_laws*flight* test_laws_see* test_the_laws*A10?point*
    test_the_laws*A10?plane* test_the_laws*A10?line*
test_hard_tetrahedra.py test_the_laws*vbd* test_the_laws*float32*
# of fluids: the cases that share a kernel
test_hard_fluids.py test_the_laws*F10* test_the_laws*averaged* test_the_laws*float32*
    test_the_laws*F4* test_the_laws*F6?drawn* test_the_laws*F7?two*
test_hard_xpbd.py test_a_thousandfold* test_they_hold*implicit* test_they_hold*B23*
test_hard_cloth.py test_the_laws*rk4*
test_contacts_scenes.py test_layers*
test_surface_contacts_scenes.py test_a_heap_comes* test_the_creature*
test_links.py test_a_sheet_hangs*
test_distance_field_scenes.py *mill
test_tetrahedra_cpu.py test_b21*neo*vbd? test_b21*recovers?corotated*vbd?
test_vbd_chebyshev.py test_a_stiff*
test_vbd_contact.py test_a_belt* *60.0? test_surfaces_keep*
test_bodies_rest.py test_the_catalogues*
test_bodies_hard.py test_a_soft_body_finds*plane-float64?
test_mesh_collider_scenes.py test_jelly_stays* test_more_triangles*
test_motion_scenes.py test_the_twisted_sheet*
test_particle_contacts.py test_the_catalogues*
test_spare.py test_what_leaves*
test_contact_restitution.py test_a_swarm*
test_mesh.py *hundred_and_sixty*
test_side_by_side.py test_the_clocks*
test_view3d_demo.py test_a_pulled_cloth*
test_bars_of_peers.py test_peers_move*
# of tetrahedra: one solver, one budget, one case by default
test_element_projections.py test_larger_bars* test_quick_is*
test_advise_tetrahedra.py test_measured_bars* test_what_is_advised* test_stiff_bars*
test_tetrahedra_experiment.py test_both_errors*
test_tetrahedra_meshes.py test_a_swing*newton?
test_hard_tetrahedra.py test_the_laws*newton* test_the_laws*B2[23]*
test_kinematic.py *newton? *vbd?
test_attachments.py *newton? *vbd? *newton-0.001? *vbd-0.0?
test_matter.py *vbd?
test_newton_coarse.py test_a_step_needs*
test_vbd_cpu.py test_a_cantilever*
test_surface_contacts.py test_a_face_stops*
test_surface_contacts_scenes.py test_the_catalogues_heap*
test_bar.py test_tetrahedra_are*
test_compiled.py *tetrahedra?that?meet? *source?mesh? *source?vertex?blocks? *held?and?moved? *bodies?that?meet?
test_quick.py test_throughput*
test_hard_bodies.py test_the_laws*B16*
test_peers_blocked.py test_once_tells*
# experiments whose parts are tested by themselves
test_accuracy.py test_nothing_is_measured* test_front_against* test_what_the_store_gains*
    test_a_cloth_is_judged* test_figures_know_the_cloth* test_points_of* test_a_reference_of_contacts
test_accuracy_s6.py test_errors_of_the_rope test_implicit_euler_among* test_the_figure_shows* test_a_rope_at_rest*
    test_references_of*
test_accuracy_xpbd.py test_the_published_errors*
test_iterations.py test_two_errors*
test_ablate.py test_of_chaos* test_dropping_a_random*
test_advise.py test_no_cheaper*0.0001? test_no_cheaper*0.2? test_no_cheaper*0.01?
test_advise_tetrahedra.py test_float32*
test_bar.py test_windows*cpu-1? test_bodies_keep*
test_reading.py test_neither_figures*
test_throughput.py test_quick_is*
test_plan.py test_a_stage_that_does_more*
# under the CUDA simulator: each kernel once; real GPUs run the rest
test_simulated_scatter.py test_the_cost*
test_simulated_hard.py *A10?rigid*
test_simulated_hard.py *B16* *B20-float*
test_simulated_lattice.py test_windows_in_turn*
# the same again in plain Python or on a CPU's machine code: a value fewer, a second judge, a picture
test_bodies_catalogue.py test_bodies_fall*cloth-on-jelly? test_what_waits*
test_rebound.py test_two_that_meet*1.0-3000.0?
test_hard_bodies.py test_they_are_listed* *A10?mirrored* *A10?inside* *S7?4-float32?
test_physics_hard.py *cpu-B1?hanging-velocity-verlet?
test_physics_conservation.py *elastic_pendulum*cpu-rk4*
test_reference.py test_rk4*0.03-1.0?
test_cloth_orders.py test_holds*semi*springs-cpu? test_orders*verlet?in?wind*
test_cpu_reference.py test_published*s1?and?s2*hammock-lab*
test_finite_elements_newton.py test_elastica?4-*
test_tetrahedra_reference.py test_few*-4-1-* test_few*-16-1-* test_few*-128-1-* test_few*?100000.0-* test_few*?10000000.0-*
    test_few*-4-8-* test_damped_rows* test_blocks*?4-* test_at_rest*?2? test_sweeps_approach*?corotated?
test_xpbd_laws.py test_mass_ratio*cpu-100-1-jacobi* test_mass_ratio*cpu-10-10*
test_bar.py test_windows*cpu-2? test_nothing_is_measured_twice* test_springs_do_not*
test_stability.py test_a_run_is_stored* *edge*float32-explicit* *edge*float32-semi* *edge*float32-velocity*
test_iterations.py test_iterations_leave*
test_accuracy_s6.py test_converged*
test_labbook.py test_the_book_is_built*
test_findings.py *
test_no_trace.py test_the_cpu_has_no_instruction*
test_vertex_timing.py test_both_ways*
test_newton.py test_single_precision* test_what_falls*
test_compiled.py *implicit?tetrahedra*
test_compiled.py *sheets?of?bodies*
test_ablate.py test_a_time_between* test_asked_again* test_the_command_prints* test_interrupted* test_the_figure_and*
# dear to compile, and the same again with fewer parts or other numbers
test_compiled.py *?grid?in?stages? *grid?of?two?springs*
# of what a CUDA kernel compiles to, the largest ones: CI runs them all where it has the compiler
test_no_trace.py *lab-parts1*float32?
# two thousand meshes of every kind
test_tetrahedra_soup.py test_two_thousand*
# the tool that measures how many deliberate mistakes are noticed (python -m tests.mistakes), end to end
test_mistakes.py test_mistakes_are_noticed*
""")

# Of the parametrised tests in these files, which are dear for each variant, as many variants run by default as show every
# value of every parameter (tests/tools/variants.py).
THINNED = {
    "test_accuracy_s6.py", "test_accuracy_xpbd.py", "test_b1.py", "test_b1_limits.py", "test_bodies_solver.py",
    "test_cloth_assembly.py", "test_cloth_colliders.py", "test_cloth_cpu.py", "test_cloth_orders.py",
    "test_cloth_reference.py", "test_contact_restitution.py", "test_contacts.py", "test_contacts_scenes.py",
    "test_cpu_reference.py", "test_distance_field_cloths.py", "test_hard_bodies.py",
    "test_hard_cloth.py", "test_hard_xpbd.py", "test_implicit.py", "test_implicit_newton.py", "test_iterations.py",
    "test_links.py", "test_matching.py", "test_motion.py", "test_motion_scenes.py", "test_no_trace_ptx.py",
    "test_particle_contacts.py", "test_ptx.py", "test_rebound.py", "test_rotation.py", "test_simulated_contacts.py",
    "test_simulated_hard.py", "test_simulated_lattice.py", "test_simulated_particle_contacts.py",
    "test_spare.py", "test_xpbd_assembly.py", "test_xpbd_cpu_reference.py", "test_xpbd_laws.py", "test_xpbd_mesh_cpu.py",
}  # fmt: skip
