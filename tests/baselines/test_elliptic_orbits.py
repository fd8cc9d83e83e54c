"""What is made for a circular orbit says so in one line; what is not works about an ellipse."""

from __future__ import annotations

import numpy as np
import pytest

from thruster_baselines.control import ApproachController
from thruster_baselines.control.navigation import RelativeNavigation
from thruster_baselines.detection.pulses.motion import MotionFit
from thruster_baselines.detection.residuals.norm_threshold import named_design
from thruster_baselines.estimation.rate_change import thrust_rate_change
from thruster_baselines.guidance import RendezvousPlanner
from thruster_envs.physics.orbits import transition_matrix
from thruster_envs.spacecraft import Orbit, load

ELLIPSE = Orbit(mean_motion=0.0011, eccentricity=0.2, true_anomaly=1.0)
STATE = np.array([10.0, -20.0, 5.0, 0.1, 0.05, -0.02, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])


@pytest.mark.parametrize(
    ("vehicle", "make"),
    [
        ("orion", RendezvousPlanner),
        ("orion", RelativeNavigation),
        ("orion", lambda craft: thrust_rate_change(craft, STATE, STATE, 5.0)),
        ("msr_chaser", lambda craft: ApproachController(craft, 300)),
        ("msr_chaser", lambda craft: named_design(craft, "observer")),
        ("ppt_cubesat", lambda craft: MotionFit(craft, 1e-6)),
    ],
)
def test_what_needs_a_circular_orbit_refuses_an_elliptic_one(vehicle, make):
    craft = load(vehicle).replace(orbit=ELLIPSE)
    with pytest.raises(
        ValueError, match=r"needs a circular orbit: the eccentricity of .* must be 0, got 0\.2$"
    ):
        make(craft)


def test_the_rate_change_of_a_free_interval_about_an_ellipse_is_nothing():
    """Free motion of the relative state is taken off, wherever on the ellipse it takes place."""
    craft = load("orion").replace(orbit=ELLIPSE)
    after = STATE.copy()
    after[:6] = transition_matrix(ELLIPSE, 60.0, 700.0) @ STATE[:6]
    change = thrust_rate_change(craft, STATE, after, 60.0, time=700.0)
    np.testing.assert_allclose(change, 0.0, atol=1e-15)
