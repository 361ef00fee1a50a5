"""Printed by `make generated` from `compensate.tables`; not to be edited."""

# mypy: ignore-errors
# ruff: noqa
# fmt: off

from wrenchgap.compensate import tables as t
from wrenchgap.compensate.compiling import cube, matrix, opening, vector


@opening
def opened(numbers, counts):
    """`Everything` as it lies in the two arrays, what is remembered as one array (M,), and as much room."""
    # Long because every array has a line.
    WG_LIMITS = counts[0]
    WG_SINGLES = counts[1]
    WG_TILTING = counts[2]
    WG_INPUTS = counts[3]
    WG_OUTPUTS = counts[4]
    WG_POINTS = counts[5]
    WG_WHITENER = counts[6]
    PHYSICS_LINES = counts[7]
    PHYSICS_ASKED = counts[8]
    PHYSICS_FREE = counts[9]
    PHYSICS_RESULTS = counts[10]
    PHYSICS_SLOPED = counts[11]
    SENT_LINES = counts[12]
    SENT_ASKED = counts[13]
    SENT_FREE = counts[14]
    SENT_RESULTS = counts[15]
    SENT_SLOPED = counts[16]
    WG_ACTUATORS = counts[17]
    WG_STATE = counts[18]
    WG_FIXED = counts[19]
    f, i = 0, 20
    compensation_reach_rows, f = matrix(numbers, f, WG_LIMITS, 6)
    compensation_reach_low, f = vector(numbers, f, WG_SINGLES)
    compensation_reach_high, f = vector(numbers, f, WG_SINGLES)
    compensation_reach_middle, f = vector(numbers, f, WG_TILTING)
    compensation_reach_half, f = vector(numbers, f, WG_TILTING)
    compensation_reach_weak, f = vector(numbers, f, WG_TILTING)
    compensation_reach_authority, f = vector(numbers, f, 6)
    compensation_reach_hover, f = vector(numbers, f, 6)
    compensation_reach_solve, f = matrix(numbers, f, 6, 6)
    compensation_process_input_mean, f = vector(numbers, f, WG_INPUTS)
    compensation_process_input_scale, f = vector(numbers, f, WG_INPUTS)
    compensation_process_output_scale, f = vector(numbers, f, WG_OUTPUTS)
    compensation_process_coefficients, f = matrix(numbers, f, WG_OUTPUTS, WG_INPUTS + 1)
    compensation_process_lengthscales, f = matrix(numbers, f, WG_OUTPUTS, WG_INPUTS)
    compensation_process_points, f = cube(numbers, f, WG_OUTPUTS, WG_INPUTS, WG_POINTS)
    compensation_process_alpha, f = matrix(numbers, f, WG_OUTPUTS, WG_POINTS)
    compensation_process_whitener, f = matrix(numbers, f, WG_OUTPUTS, WG_WHITENER)
    compensation_process_signal, f = vector(numbers, f, WG_OUTPUTS)
    compensation_process_noise, f = vector(numbers, f, WG_OUTPUTS)
    compensation_process_sigma_scale, f = vector(numbers, f, WG_OUTPUTS)
    compensation_process_triangular, i = counts[i], i + 8
    compensation_gate_rows, i = vector(counts, i, WG_OUTPUTS)
    compensation_gate_bound, f = vector(numbers, f, WG_OUTPUTS)
    compensation_gate_known, f = vector(numbers, f, WG_OUTPUTS)
    compensation_gate_watched, i = vector(counts, i, WG_OUTPUTS)
    compensation_gate_offset, f = vector(numbers, f, WG_OUTPUTS)
    compensation_gate_scale, f = vector(numbers, f, WG_OUTPUTS)
    compensation_gate_looked, i = vector(counts, i, 15)
    compensation_gate_accept, f = numbers[f], f + 8
    compensation_gate_enough, f = numbers[f], f + 8
    compensation_gate_pivot, f = numbers[f], f + 8
    compensation_gate_still, f = numbers[f], f + 8
    compensation_gate_stalled, f = numbers[f], f + 8
    compensation_gate_threshold, f = numbers[f], f + 8
    compensation_gate_kappa, f = numbers[f], f + 8
    compensation_gate_decay, f = numbers[f], f + 8
    compensation_gate_lag_a, f = numbers[f], f + 8
    compensation_gate_lag_b0, f = numbers[f], f + 8
    compensation_gate_lag_b1, f = numbers[f], f + 8
    compensation_gate_most, i = counts[i], i + 8
    compensation_gate_lenient, i = counts[i], i + 8
    compensation_gate_has_process, i = counts[i], i + 8
    compensation_gate_has_physics, i = counts[i], i + 8
    compensation_gate_velocity_at, i = counts[i], i + 8
    compensation_gate_rates_at, i = counts[i], i + 8
    compensation_gate_position_at, i = counts[i], i + 8
    compensation_gate_past_at, i = counts[i], i + 8
    compensation_physics_code, i = matrix(counts, i, PHYSICS_LINES, 4)
    compensation_physics_inputs, i = vector(counts, i, PHYSICS_ASKED)
    compensation_physics_free, i = vector(counts, i, PHYSICS_FREE)
    compensation_physics_results, i = vector(counts, i, PHYSICS_RESULTS)
    compensation_physics_value, f = vector(numbers, f, PHYSICS_LINES)
    compensation_physics_tangent, f = matrix(numbers, f, PHYSICS_SLOPED, WG_OUTPUTS)
    compensation_physics_split, i = counts[i], i + 8
    compensation_sent_code, i = matrix(counts, i, SENT_LINES, 4)
    compensation_sent_inputs, i = vector(counts, i, SENT_ASKED)
    compensation_sent_free, i = vector(counts, i, SENT_FREE)
    compensation_sent_results, i = vector(counts, i, SENT_RESULTS)
    compensation_sent_value, f = vector(numbers, f, SENT_LINES)
    compensation_sent_tangent, f = matrix(numbers, f, SENT_SLOPED, WG_OUTPUTS)
    compensation_sent_split, i = counts[i], i + 8
    first = f
    memory_optimum, f = vector(numbers, f, 6)
    memory_correction, f = vector(numbers, f, 6)
    memory_known, f = vector(numbers, f, 6)
    memory_sent, f = vector(numbers, f, 6)
    memory_lag_in, f = vector(numbers, f, 6)
    memory_lag_out, f = vector(numbers, f, 6)
    memory_stage, f = vector(numbers, f, 1)
    memory_fresh, f = vector(numbers, f, 1)
    memory_actuators, f = vector(numbers, f, WG_ACTUATORS)
    flat = numbers[first:f]
    before, f = vector(numbers, f, len(flat))
    room_reach_x, f = vector(numbers, f, WG_LIMITS)
    room_reach_z, f = vector(numbers, f, WG_LIMITS)
    room_reach_u, f = vector(numbers, f, WG_LIMITS)
    room_reach_shares, f = vector(numbers, f, 6)
    room_reach_wanted, f = vector(numbers, f, 6)
    room_reach_pull, f = vector(numbers, f, 6)
    room_reach_between, f = vector(numbers, f, 6)
    room_wrench, f = vector(numbers, f, 6)
    room_told, f = vector(numbers, f, WG_STATE)
    room_fixed, f = vector(numbers, f, WG_FIXED)
    room_xi, f = vector(numbers, f, WG_INPUTS)
    room_at, f = vector(numbers, f, WG_INPUTS)
    room_values, f = matrix(numbers, f, WG_OUTPUTS, WG_POINTS)
    room_sums, f = vector(numbers, f, WG_OUTPUTS)
    room_white, f = vector(numbers, f, WG_POINTS)
    room_mean, f = vector(numbers, f, WG_OUTPUTS)
    room_slope, f = matrix(numbers, f, WG_OUTPUTS, WG_OUTPUTS)
    room_command, f = vector(numbers, f, WG_OUTPUTS)
    room_std, f = vector(numbers, f, WG_OUTPUTS)
    room_r, f = vector(numbers, f, WG_OUTPUTS)
    room_A, f = matrix(numbers, f, WG_OUTPUTS, WG_OUTPUTS)
    room_r_at, f = vector(numbers, f, WG_OUTPUTS)
    room_A_at, f = matrix(numbers, f, WG_OUTPUTS, WG_OUTPUTS)
    room_H, f = matrix(numbers, f, WG_OUTPUTS, WG_OUTPUTS)
    room_x, f = vector(numbers, f, WG_OUTPUTS)
    room_trial, f = vector(numbers, f, WG_OUTPUTS)
    room_best, f = vector(numbers, f, WG_OUTPUTS)
    room_start, f = vector(numbers, f, WG_OUTPUTS)
    room_low, f = vector(numbers, f, WG_OUTPUTS)
    room_high, f = vector(numbers, f, WG_OUTPUTS)
    room_ratio, f = vector(numbers, f, 1)
    room_evaluations, i = vector(counts, i, 1)
    room_hard, i = vector(counts, i, 1)
    return t.Everything(t.Compensation(t.ReachTable(compensation_reach_rows, compensation_reach_low, compensation_reach_high, compensation_reach_middle, compensation_reach_half, compensation_reach_weak, compensation_reach_authority, compensation_reach_hover, compensation_reach_solve), t.Process(compensation_process_input_mean, compensation_process_input_scale, compensation_process_output_scale, compensation_process_coefficients, compensation_process_lengthscales, compensation_process_points, compensation_process_alpha, compensation_process_whitener, compensation_process_signal, compensation_process_noise, compensation_process_sigma_scale, compensation_process_triangular), t.Gate(compensation_gate_rows, compensation_gate_bound, compensation_gate_known, compensation_gate_watched, compensation_gate_offset, compensation_gate_scale, compensation_gate_looked, compensation_gate_accept, compensation_gate_enough, compensation_gate_pivot, compensation_gate_still, compensation_gate_stalled, compensation_gate_threshold, compensation_gate_kappa, compensation_gate_decay, compensation_gate_lag_a, compensation_gate_lag_b0, compensation_gate_lag_b1, compensation_gate_most, compensation_gate_lenient, compensation_gate_has_process, compensation_gate_has_physics, compensation_gate_velocity_at, compensation_gate_rates_at, compensation_gate_position_at, compensation_gate_past_at), t.Tape(compensation_physics_code, compensation_physics_inputs, compensation_physics_free, compensation_physics_results, compensation_physics_value, compensation_physics_tangent, compensation_physics_split), t.Tape(compensation_sent_code, compensation_sent_inputs, compensation_sent_free, compensation_sent_results, compensation_sent_value, compensation_sent_tangent, compensation_sent_split)), t.Memory(memory_optimum, memory_correction, memory_known, memory_sent, memory_lag_in, memory_lag_out, memory_stage, memory_fresh, memory_actuators), t.Room(t.ReachRoom(room_reach_x, room_reach_z, room_reach_u, room_reach_shares, room_reach_wanted, room_reach_pull, room_reach_between), room_wrench, room_told, room_fixed, room_xi, room_at, room_values, room_sums, room_white, room_mean, room_slope, room_command, room_std, room_r, room_A, room_r_at, room_A_at, room_H, room_x, room_trial, room_best, room_start, room_low, room_high, room_ratio, room_evaluations, room_hard)), flat, before
