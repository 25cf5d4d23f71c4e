"""Tests that `pytest --rest` alone runs, by what they take."""

from __future__ import annotations

from tiers import table

# Tests for --rest alone, where they run as they would by default: each took more than a second of a core, by measurement,
# and of each room and law quicker ones stay.
OVER_A_SECOND = table("""
test_ablate.py test_over_the_limit* test_dropped_parts*
test_accuracy.py test_the_cloth_belongs_to_the_full_mode
test_accuracy_s6.py test_implicit_euler_of_a_loaded_rope
test_accuracy_xpbd.py test_a_run_with_a_load_is_judged_by_a_reference_that_knows_it test_a_name_picks*
test_advise.py test_an_error_that_nothing_reaches test_chaos_forbids_an_answer
    test_no_cheaper_configuration_of_the_grid_reaches_the_error?0.001?
    test_what_a_first_step_compiles_is_no_steps_time?1000-1e-06-None? test_the_command_writes* test_an_answer_in_words*
    test_own_reference*
test_attachments.py test_a_side_turns_with_a_mesh_that_spins test_a_vertex_is_drawn_to_a_point
    test_surfaces_that_an_attachment_holds_together_do_not_push_each_o* test_a_body_on_soft*
test_b1.py *rk4*
test_b1_limits.py *rk4*
test_bad_sizes.py test_a_full_standard_output_is_a_line
test_baked.py test_damaged_files_are_made_anew
test_bar.py test_a_jelly_bar_swings_as_its_clusters_say?cpu? test_springs_are_a_chain?cpu-mass-spring-1-verlet_frequency?
    test_springs_are_a_chain?cpu-xpbd-32-implicit_frequency?
test_bar_told.py test_figures_are_drawn_or_say_why_not test_backends_are_held_against_each_other
test_bars_of_peers.py test_an_answer_that_takes_too_long_is_not_waited_for
test_bits.py *crowded-float32? *xpbd-attached-float64? *vbd-slope-float64?
test_bodies_hard.py test_a_ball_inside_a_body_pushes_it_out_in_place test_another_body_stops* test_a_hit_keeps_linear*
    test_what_goes_too_far* test_what_begins_inside* test_a_hit_keeps_angular* test_a_soft_body_finds* test_a_plane_stops*
test_bodies_rest.py test_what_was_dropped* test_bodies_that_were* test_a_heap_of_eight* test_a_brick_bears*
    test_iterations_make* test_a_stack_sleeps* test_ten*
test_bodies_run.py test_the_catalogue_is_readable_at_80_columns
test_claims_by_hand.py test_wrong_answers_change_no_sentence
test_cli.py test_what_only_tells?doctor? test_what_only_tells?scenes?
test_cloth_beside.py test_the_weight_of_what_rests_on_a_cloth_arrives_at_its_pins
    test_a_box_slides*
test_cloth_orders.py test_orders?rk4?with?all-reference? test_orders?verlet?damped-reference? test_orders*semi* test_holds*
test_cloth_reference.py test_hanging_column?cpu? test_one_damped_spring?shear-ends1-cpu?
    test_springs_and_their_dampers_keep_both_momenta?semi-implicit-euler-*
test_compiled.py test_fast_math_stays_near_exact?grid? test_machine_code_gives_the_bits_of_its_source?jelly?grid?
    test_machine_code_gives_the_bits_of_its_source?cloth? test_machine_code_gives_the_bits_of_its_source?grid?in?teams?
    test_machine_code_gives_the_bits_of_its_source?grid?in?tiles? test_machine_code_gives_the_bits_of_its_source?grid,?rk4?
    test_machine_code_gives_the_bits_of_its_source?xpbd?
test_cpu_assembly.py test_loops_along_rows_take_packed_roots_alone?tiled-float32-fast?
    test_loops_along_rows_take_packed_roots_alone?fused-float32-exact?
    test_loops_along_rows_take_packed_roots_alone?fused-float32-fast?
test_cpu_kernels.py test_parts_that_know_their_place_do_so_in_every_tile test_odd_shapes*velocity-verlet*
test_cpu_reference.py test_integrators_over_200_steps?cpu-float64-stages-velocity-verlet?
    test_published_errors_of_s1_and_s2?cpu-lab-hammock-semi*
    test_integrators_over_200_steps?cpu-float32-fused-velocity-verlet?
    test_published_errors_of_an_explicit_damper?lab-hammock-0.02? test_integrators*rk4* test_published*0.01?
    test_published*lab-curtain*
test_cuda_vertices.py test_a_gpus_state_is_written_into_the_buffers_and_the_picture_is_t*
    test_kernels_of_float64_write_float32
test_digest.py test_a_digest_is_the_same_in_every_process test_touching_any_file_of_a_backend_changes_its_sources?gpu?
test_distance_field_cloths.py test_nobody_enters_it?xpbd? test_nobody_enters_it?implicit-euler? test_nobody_enters_it?mesh?
    test_nobody_enters_it?rk4?
test_distance_field_scenes.py test_a_cloth_falls_on_it?cpu?
test_docs.py test_the_errors_in_the_example_are_as_told
test_drawing.py test_a_helper_draws_the_same
test_entered_keys.py test_other_kernels_are_measured_anew?version? test_other_kernels_are_measured_anew?nothing*
test_fields.py test_the_world_of_the_page_runs*
test_figure_axes.py test_curves_are_what_the_axes_say?time-per-step?GPU?
test_film.py test_a_film
test_findings_costs.py *
test_finite_elements_newton.py test_elastica?2-1.0-corotated? test_elastica?2-1.0-fixed-corotated?
    test_implicit_euler_comes_to_rest_and_falls?corotated?
test_finite_elements_peer.py test_the_continuum
test_flex_12.py *over_a_plane?cpu-fast-float32? *over_a_plane?cpu-fast-float64? *over_a_plane?cpu-exact-float64?
test_fluid_cpu.py test_against_the_judge_and_the_same_bits?cup? test_against_the_judge_and_the_same_bits?averaged?
    test_against_the_judge_and_the_same_bits?column? test_against_the_judge_and_the_same_bits?two?fluids?
    test_live_fields_and_pressures test_against*free*
test_fluid_divergence.py test_a_lattice_without_weight_stays
test_fluid_flow.py test_against_the_judge_and_the_same_bits?tap?
test_fluid_solids.py test_it_is_the_judges_and_the_same_bits_on_any_threads?alone?
test_fluid_view.py test_a_fluid_is_seen?space?
test_foam.py test_as_many_are_made_as_sources_say_and_always_the_same?3?
test_friction_on_colliders.py *
test_hard_bodies.py test_the_laws*B18* test_the_laws*B17*
test_hard_cloth.py test_laws_see_a_ball_that_is_passed?hard/b17?
test_hard_fluids.py test_verdicts_go* test_the_laws*
test_hard_tetrahedra.py test_the_laws*B21* test_the_laws*A8*
test_hard_xpbd.py test_tethers_hold_a_long_chain?xpbd?gauss-seidel? test_tethers_hold_a_long_chain?xpbd?jacobi?
    test_they_hold?B4?zero-xpbd?jacobi? test_they_hold?B4-xpbd?gauss-seidel?
test_implicit.py test_it_follows*everything* test_it_follows*springs-implicit-euler-10*
test_implicit_newton.py test_converged_xpbd_is_implicit_euler_but_for_the_turning
test_iterations.py test_residuals_of_one_constraint_vanish
test_joules.py test_joules*
test_kernel_keys.py test_a_rename_across_a_package* test_a_start_state* test_a_colouring*
test_kernel_sweep.py test_a_kernel_that_breaks_is_skipped_with_its_reason
    test_arithmetic_rates_are_measured_for_both_precisions test_every_kernel_is_a_configuration_of_its_name_and_checked_and_r*
    test_forced_and_chosen_kernels_do_not_mix test_a_wrong_kernel*
test_kinematic.py test_a_body_s_own_damping_is_a_terminal_speed?xpbd? test_a_body_that_moves_as_its_end_does_goes_on_so?xpbd?
test_lattice.py test_sums_along_axes_are_direct_sums?counts1-3? test_sums_along_axes_are_direct_sums?counts3-2?
test_libuipc_442.py test_other_solvers*
test_machine_code.py test_machine_code_is_a_proof*
test_matter.py test_two_halves_that_are_drawn_give_as_springs_in_series_do test_every_solver* test_a_body_with_a_limit*
test_mesh_collider.py test_a_cloth_falls_on_it?cpu?
test_motion.py test_pins_are_where_their_motion_has_them?rk4-float32?
    test_the_interval_in_which_a_state_went_bad_is_replayed_with_its_m*
    test_pins_are_where_their_motion_has_them?velocity-verlet-float32?
test_motion_scenes.py test_orders_are_kept?rk4-reference?
test_mpi.py test_without_mpiexec_one_line_says_how_to_get_it
test_newton.py *
test_newton_order.py test_orders* test_a_swing* test_a_bar* test_a_run* test_the_limit* *judges?fixed-corotated?
test_no_trace.py test_the_cpu_reads*
test_offscreen.py test_missing_libraries_are_named_with_a_remedy?pyglet.gl-Library?"*
    test_missing_libraries_are_named_with_a_remedy?pyglet.text-Library*
    test_missing_libraries_are_named_with_a_remedy?pyglet.window-Libra* test_the_renderer_says_its_name
test_orders.py test_order_of_each*rk4* test_linear_lattice*rk4* test_published_errors*rk4*
test_panel_drawing.py test_a_frame_covers_its_column_and_nothing_else?light?
test_partitions.py *vbd*
test_peers_blocked.py test_the_quickest_tile_is_kept_and_what_cannot_be_opened_left_out
    test_the_source_compiles_for_a_real_architecture?64x128h4?of?16?wa*
    test_the_source_compiles_for_a_real_architecture?64x64h4?of?8?warp*
    test_the_reference_is_met_within_rounding?one-block-32x12h1?of?3?warp*
    test_the_reference_is_met_within_rounding?one-block-64x8h1?of?4?warps*
    test_the_reference_is_met_within_rounding?resident-32x12h3?of?3?warps*
    test_the_reference_is_met_within_rounding?tiles-32x6h2?of?3?warps-(11*
    test_the_reference_is_met_within_rounding?tiles-64x12h3?of?4?warps-(2*
test_physics_conservation.py test_rk4_loses_angular_momentum?cpu-20.0? test_rk4_loses_angular_momentum?cpu-5.0?
    *elastic_pendulum*
test_physics_hard.py *cpu-B6-lab? *cpu-B6-velocity* *cpu-B7?mirrored-lab? test_hard_case?cpu-B11-lab?
    test_hard_case?cpu-B16-lab? test_hard_case?cpu-B16-velocity-verlet? test_hard_case?cpu-B17-lab?
    test_hard_case?cpu-B17-velocity-verlet? test_hard_case_in_float32*B15* test_hard_case*B5*
test_physics_point.py test_free_fall?cpu-float32-stages-rk4-0.0?
test_physics_statics.py test_two_corner*
test_pools.py test_workers_by_submitit test_slurm*
test_rebound.py test_two_that_meet* test_among* test_it_comes*
test_recomputed.py test_no_printed_sentence_rests_on_nothing_but_marked_times_silently test_the_gpu_against_the_cpu?False?
test_reference.py test_control_values_of_the_accuracy_scenes?lab-hammock-total1-corn* test_the_error_estimate_is_honest
    test_control_values_of_the_accuracy_scenes?lab-curtain*
    test_rk4_with_richardson_reaches_another_integrators_answer?0.0-1.0?
test_resting_skins.py test_rigid_bodies* test_bodies_of_voxels* test_of_a_soft_body* test_the_named_body*
test_restitution.py test_a_cloth_bounces_off_all_kinds?cpu? test_a_ball_comes_back_to_the_restitutions_square?cpu-0.001-1.0?
    test_a_ball_comes_back_to_the_restitutions_square?reference-0.001-1.0? *bodies-0.004*
test_rotation.py test_it_is_the_rotation_of_the_singular_value_decomposition?random*
    test_it_is_the_rotation_of_the_singular_value_decomposition?rigid-*
    test_it_is_the_rotation_of_the_singular_value_decomposition?by?name-f*
    test_it_is_the_rotation_of_the_singular_value_decomposition?mirrored-* *float64* test_of_any_matrix*
test_same_machine.py test_the_whole_catalogue*
test_shapes.py test_every_shape_is_a_body?octopus-coarsest? test_every_shape_is_a_body?creature-40?
    test_every_shape_is_a_body?creature-47? test_every_shape_is_a_body?creature-coarsest?
test_shared_projections.py test_ranks*small-steps*-8-4? test_ranks_have_the_bits_of_one?cloth-small-steps-changes2-3-None-Non*
test_simulated_domains.py test_a_cloth_of_constraints*
test_simulated_fluid_solids.py test_the_bits_are_the_cpus?alone-float64? test_the_bits*walls*
test_simulated_laws.py *world* *newton* *vbd*
test_simulated_scaling.py *
test_simulated_shared_fluid.py test_slabs_have_the_bits_of_the_cpu?3-float64?
test_simulated_wet_worlds.py test_live*
test_sleep.py test_what_falls_slowly_goes_on test_who_loses_what_bore_it_falls test_what_rests*
test_soft_body.py test_orphans_are_refused_with_the_radius_that_would_do?octopus?
test_spare.py test_what_waits_changes_no_bit?contacts-fused-3? test_what_waits_changes_no_bit?contacts-fused-1?
test_stability.py test_without_a_damper_there_is_no_edge_to_measure?taylor? test_slow_growth* test_the_measured_edge*-0.0?
    test_the_measured_edge*-3.0?
test_stability_figures.py test_a_panel_an_integrator?draw_damping?
test_stability_limits.py test_limit_is_the_edge_of_every_slower_mode
test_surface_contacts.py test_a_body_meets_itself_where_it_says_so
    test_a_cube_slides_where_the_slope_is_over_the_friction_and_sticks* test_four_sweeps_tell_sticking_from_sliding*
    test_bodies_that_are_far* test_what_begins_inside*
test_surface_levers.py test_none_of_ten_thousand_contacts_gains_energy*
test_sweep_on_many.py test_a_sweep_that_is_killed*
test_tetrahedra_cpu.py test_b21*flat-xpbd? test_b21*vbd?
test_tetrahedra_meshes.py test_a_swing*
test_tetrahedra_peer.py test_it_is_asked_and_checked test_its_states_are_the_lab_s?float32-2e-05-tetrahedra?
test_tetrahedra_reference.py test_at_rest_is_where_steps_come_to_rest?1?
    test_few_sweeps_sag_too_far?1000000.0-30-1-1.089-1.0902? test_few_sweeps_sag_too_far?1000000.0-64-1-1.018-1.0185?
    test_damping_by_a_time?rows?
test_tiling.py test_tiles_put_together_are_the_grid
test_toys.py test_a_constraint_limits_stretches_alone test_an_integrator_falls_along_the_parabola
    test_one_entry_and_every_solver_has_it
test_turns.py test_a_lock*
test_vbd_contact.py test_a_cube_lands_without_more_energy_and_rests_as_high_as_its_mes* test_what_friction* test_what_slides*
test_vbd_reference.py test_a_step_is_the_judges?corotated-0.01-0.0?
test_vertex_timing.py test_a_way_that_cannot_be_had_has_its_reason
test_viewer.py test_dragging_pulls_a_mass_to_the_pointer_and_lets_go test_importing_the_drawing_loads_no_pyglet
test_volume.py test_a_ball_keeps_its_volume_where_its_edges_alone_would_not
test_voxel_accuracy.py *
test_voxel_mesh.py test_whole_voxels_are_found_whatever_rounding_makes_of_them
test_voxel_pieces.py test_pieces_and_what_joins_them_are_those_that_counting_finds?0?
    test_pieces_and_what_joins_them_are_those_that_counting_finds?2?
    test_pieces_and_what_joins_them_are_those_that_counting_finds?3?
test_world_cpu.py test_members_that_nothing_couples_move_as_each_alone?all-float32?
    test_members_that_nothing_couples_move_as_each_alone?jelly?on?a?block*
    test_tetrahedra_by_vertices* test_momentum*
test_xpbd_cpu.py test_members*
test_xpbd_cpu_reference.py test_attachments_hold_every_mass test_stages_follow_the_reference?air-gauss-seidel?
test_xpbd_laws.py test_a_rigid_rope_is_too_long_by_h_squared?cpu-jacobi?
    test_error_against_the_motion_of_the_springs?cpu-S1-0.0025-1-0.00537?
    test_error_against_the_motion_of_the_springs?cpu-S1-0.0025-4-0.00239? test_mass_ratio_1000?cpu-1-100-gauss-seidel-97.6?
    test_a_rigid_rope_is_too_long_by_h_squared?cpu-gauss-seidel? test_mass_ratio_1000?cpu-1-20-gauss-seidel-191?
    test_mass_ratio*cpu-100* test_error_against*S1-0.01-4* test_error_against*S1-0.000625* test_error_against*S1-0.01-20*
    test_error_against*S2*
test_xpbd_reference_sheets.py test_orderings_agree_when_converged?True?
""")
