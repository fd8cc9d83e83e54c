"""The delta-v still to go, against the matrix exponential of Hill's equations."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.linalg import expm

from thruster_envs.tasks.shaping import SHORTEST, delta_v_to_go

N = 0.0011
HILL = np.zeros((6, 6))
HILL[:3, 3:] = np.eye(3)
HILL[3, 0], HILL[3, 4], HILL[4, 3], HILL[5, 2] = 3.0 * N**2, 2.0 * N, -2.0 * N, -(N**2)

meters, speeds = st.floats(-1000.0, 1000.0), st.floats(-2.0, 2.0)


def two_impulses(position, velocity, time):
    """First and second impulse (m/s) of the transfer that is at rest at the origin after ``time``."""
    transition = expm(HILL * time)
    needed = np.linalg.solve(transition[:3, 3:], -transition[:3, :3] @ position)
    arrival = transition[3:, :3] @ position + transition[3:, 3:] @ needed
    return needed - velocity, -arrival


@given(st.tuples(meters, meters, meters), st.tuples(speeds, speeds, speeds), st.floats(SHORTEST, 1400.0))
def test_it_is_the_two_impulse_solution_within_a_quarter_orbit(position, velocity, time):
    first, second = two_impulses(np.array(position), np.array(velocity), time)
    expected = np.abs(first).sum() + np.abs(second).sum()
    assert delta_v_to_go(position, velocity, time, N) == pytest.approx(expected, rel=1e-7, abs=1e-9)


@given(st.tuples(meters, meters), st.tuples(speeds, speeds), st.floats(1500.0, 2856.0))
def test_it_is_the_two_impulse_solution_in_the_orbital_plane_for_longer(position, velocity, time):
    position, velocity = (*position, 0.0), (*velocity, 0.0)
    first, second = two_impulses(np.array(position), np.array(velocity), time)
    expected = np.abs(first).sum() + np.abs(second).sum()
    assert delta_v_to_go(position, velocity, time, N) == pytest.approx(expected, rel=1e-7, abs=1e-9)


@given(meters, speeds, st.floats(1500.0, 2856.0))
def test_across_the_plane_stopping_now_and_braking_at_the_node_is_what_it_costs(z, w, time):
    """Stop now: |w|. The craft then swings and passes the origin a quarter of an orbit later at n |z|."""
    swung = expm(HILL * (0.5 * math.pi / N)) @ np.array([0.0, 0.0, z, 0.0, 0.0, 0.0])
    assert swung[2] == pytest.approx(0.0, abs=1e-9 * max(1.0, abs(z)))
    expected = abs(w) + abs(swung[5])
    assert delta_v_to_go((0.0, 0.0, z), (0.0, 0.0, w), time, N) == pytest.approx(
        expected, rel=1e-9, abs=1e-12
    )


@given(st.floats(0.0, 3000.0))
def test_at_rest_at_the_origin_there_is_nothing_to_go(time):
    assert delta_v_to_go((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), time, N) == 0.0


@given(st.tuples(meters, meters), st.floats(300.0, 2600.0))
def test_coasting_on_the_transfer_costs_nothing(position, time):
    """After the first impulse the delta-v to go stays that of the second one alone, whenever it is asked."""
    position = np.array((*position, 0.0))
    first, second = two_impulses(position, np.zeros(3), time)
    state = np.concatenate((position, first))
    for share in (0.0, 0.3, 0.7):
        if (1.0 - share) * time > SHORTEST:
            now = expm(HILL * share * time) @ state
            still = delta_v_to_go(tuple(now[:3]), tuple(now[3:]), (1.0 - share) * time, N)
            assert still == pytest.approx(np.abs(second).sum(), rel=1e-5, abs=1e-6)


def test_the_last_minute_is_not_divided_by_zero():
    near = delta_v_to_go((10.0, 0.0, 0.0), (0.0, 0.0, 0.0), 0.0, N)
    assert near == delta_v_to_go((10.0, 0.0, 0.0), (0.0, 0.0, 0.0), SHORTEST, N)
    assert math.isfinite(near)
