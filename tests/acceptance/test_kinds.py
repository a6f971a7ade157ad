"""Kinds of numbers that were once wrong: each file of `defects/`, and each command that was, has ten or more generated neighbours in these tests."""

from __future__ import annotations

import importlib
import math
from pathlib import Path

import pytest

LEAST = 10
TIME = "simulation.test_instants:"
WHERE = "acceptance.test_neighbours:"
# A kind: the tests of its neighbours. A file of `defects/` is named as it is there; what is no file, by the command or the input.
KINDS = {
    "gate_duty time_sine_window time_heater_each_hour": f"{TIME}test_a_gate_is_open_for_its_duty {TIME}test_a_gate_of_many_periods acceptance.test_breakpoints:test_a_square_wave_from_a_sine_misses_no_edge",
    "window_of_time time_narrow_windows": f"{TIME}test_a_window_anywhere",
    "bump_of_time": f"{TIME}test_a_narrow_signal_is_never_passed_over",
    "when_of_time": f"{TIME}test_an_event_acts_each_time {TIME}test_an_event_that_never_holds_is_told",
    "switch_of_time": f"{WHERE}test_a_junction_that_time_switches",
    "ramp_into_mass ramp_into_capacitor smoothstep_into_mass": f"{WHERE}test_a_rise_onto_a_storage",
    "encoder_edges_linear": "simulation.test_crossings:test_edges_of_an_encoder_are_counted",
    "edges_nonlinear": "simulation.test_hidden_crossings:test_instants_of_nonlinear_laws simulation.test_windows_of_states:test_no_window_is_passed_over",
    "dry_friction_reversal": "simulation.test_crossings:test_the_peak_of_friction_before_a_stop_is_not_stepped_over",
    "elastic_ball": "simulation.test_crossings:test_a_ball_that_loses_nothing_bounces_for_ever",
    "nand_if_laws_chatter": "simulation.test_continuous_laws:test_a_law_with_if_that_only_bends_runs_like_one_without",
    "tank_runs_empty": "simulation.test_continuous_laws:test_a_tank_runs_empty_and_stays_so",
    "buck_ideal_diode": "library.test_ideal_switching:test_buck_converters",
    "freewheel_diode": "library.test_ideal_switching:test_freewheeling",
    "ideal_diode_bridge": "library.test_ideal_switching:test_bridges",
    "assembly_slider_crank": f"{WHERE}test_a_crank_that_starts_anywhere",
    "models/four_bar.bg started elsewhere": "simulation.test_assemblies:test_the_crank_of_the_gallery_s_four_bar",
    "start_double_pendulum start_rates_move_pose_planar start_rates_move_pose": f"{WHERE}test_rates_alone_leave_a_chain_as_it_is_drawn",
    "start_winds_turns": f"{WHERE}test_a_kite_that_starts_elsewhere_winds_no_turn",
    "invert_two_springs invert_beside_an_integral invert_two_folded_flexures fifty_springs_one_junction": f"{WHERE}test_springs_on_one_flow_and_the_integral_of_it",
    "invert_series_capacitors invert_plate_gap": f"{WHERE}test_capacitors_in_a_row_and_a_plate",
    "invert along a path from elsewhere": f"{WHERE}test_a_path_that_begins_beside_the_start",
    "unstable_called_stable": "analysis.test_units:test_a_plate_is_pulled_in_at_a_third_of_its_gap",
    "equilibrium_of_a_drift": "analysis.test_verdict:TestRest.test_a_chain_of_integrals_drifts",
    "sampled_loop_rest_and_bode": f"{WHERE}test_rest_and_response_of_sampled_loops",
    "undamped_peak steady_rotation": f"{WHERE}test_undamped_chains_and_steady_motors",
    "whipple_modes_rounding": f"{WHERE}test_modes_where_large_forces_cancel",
    "hardly_moves": "studies.test_montecarlo:TestNotDetermined.test_an_output_that_hardly_moves",
    "diode_chain_tolerance_lost mesh8_tolerance_lost": "simulation.test_tolerance:test_networks_of_diodes_from_rest_hold_their_tolerance",
    "rectifier_arrays rectifier_flat": "simulation.test_tolerance:test_names_and_arrays_change_no_bit",
    "models/four_bar.bg at rtol 1e-6": f"{WHERE}test_four_bars_at_a_loose_tolerance",
    "nand_slow_look_ahead": f"{WHERE}test_a_gate_looks_ahead_for_no_longer_than_it_runs",
    "nand_explicit_rtol1e-11 kite_swing_rtol1e-11": f"{WHERE}test_a_pendulum_at_a_very_tight_tolerance simulation.test_kites:test_a_kite_folds_at_tight_tolerances",
    "models/manipulator.bg at rtol 1e-11": "simulation.test_tolerance:test_tight_tolerances_do_not_follow_what_rounding_excites simulation.test_tolerance:test_a_tolerance_below_rounding_is_told simulation.test_tolerance:test_every_method_tells_a_tolerance_below_rounding",
    "shockley_bridge": "simulation.test_monotone_loops:test_a_bridge_of_diodes_feeds_its_load",
    "shockley_bridge_smoothed": f"{WHERE}test_a_bridge_with_a_capacitor",
    "point_mass_on_a_rod": f"{WHERE}test_a_point_mass_swings_on_a_rod",
    "one verdict of all commands": "commands.test_verdicts:test_a_wrong_file_is_refused_by_all",
    "integral_in_parameter": "semantics.test_unchanging:test_it_is_refused_where_it_stands",
    "sequential_every": "simulation.test_samples_in_order:test_a_block_is_a_program",
    "unit_or_parameter": "semantics.test_two_readings:test_a_symbol_that_is_a_parameter",
    "charge_shared": "library.test_ideal_switching:test_integrals_across_impulses",
    "models/spatial_slider_crank.bg permuted": f"{WHERE}test_mechanisms_with_declarations_permuted",
    "slow_check_prefer_derivative": "reduction.test_without_end:test_no_expression_of_high_order_is_written",
    "a closed standard output": "commands.test_streams:test_a_stream_ends_no_command",
    "odd requests to the live server": "page.test_serve_refusals:test_odd_lengths page.test_serve_refusals:test_odd_bodies page.test_serve_refusals:test_odd_request_lines",
    "half-sent requests to the live server": "page.test_serve_refusals:test_half_sent_requests_hold_no_threads page.test_serve_refusals:test_odd_headers",
    "an empty file, random bytes": "semantics.test_hostile_files:test_a_file_without_a_model semantics.test_hostile_files:test_the_place_of_a_byte_that_is_no_text",
    "1e308, solver none": "commands.test_hostile_commands:test_a_command_line",
    "the limit of rtol": "semantics.test_hostile_files:test_the_limits_of_a_relative_tolerance simulation.test_tolerance:test_every_method_tells_a_tolerance_below_rounding",
    "LaTeX of conditions": f"{WHERE}test_brackets_close_in_latex",
    "escapes and bidi characters": "semantics.test_hostile_files:test_what_cannot_be_seen",
    "a scale of time": "simulation.test_tolerance:test_nothing_is_absolute_in_time simulation.test_explicit:test_the_choice_knows_no_unit_of_time",
}  # fmt: skip


def cases(test: str) -> int:
    """Number of the cases of a test, by its marks: all of them, as with `--long`."""
    module, _, path = test.partition(":")
    found = importlib.import_module(f"tests.{module}")
    for name in path.split("."):
        found = getattr(found, name)
    return math.prod(len(mark.args[1]) for mark in getattr(found, "pytestmark", ()) if mark.name == "parametrize")


@pytest.mark.parametrize("kind", KINDS)
def test_a_kind_has_ten_neighbours(kind: str) -> None:
    assert sum(map(cases, KINDS[kind].split())) >= LEAST


def test_every_file_has_a_kind() -> None:
    named = {word for kind in KINDS for word in kind.split()}
    assert {p.stem for p in (Path(__file__).parent / "defects").glob("*.bg")} <= named
