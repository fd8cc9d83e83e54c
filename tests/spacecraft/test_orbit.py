"""An orbit as a value: elements that belong together, in files and out, and what is refused."""

from __future__ import annotations

import math
import re

import pytest

from thruster_envs.spacecraft import Orbit, load, save
from thruster_envs.spacecraft.orbit import EARTH_J2, EARTH_MU, EARTH_RADIUS, MARS_MU

ORION = load("orion")
APOGEE = Orbit(
    semi_major_axis=29948.48e3, eccentricity=0.471, inclination=1.10497, raan=4.24115,
    argument_of_perigee=3.7350, true_anomaly=math.pi,
)  # fmt: skip


def test_the_orbit_of_a_published_reconfiguration_has_its_published_numbers():
    """Semi-major axis 4.69549 Earth radii, eccentricity 0.471; period 14.3275 h, starting at apogee."""
    assert APOGEE.period == pytest.approx(51579.0, abs=0.05)
    assert APOGEE.mean_motion == pytest.approx(1.2181668e-4, rel=2e-7)
    assert APOGEE.perigee_radius - 6378.137e3 == pytest.approx(9464.6e3, abs=50.0)
    assert 2.0 * APOGEE.semi_major_axis - APOGEE.perigee_radius == pytest.approx(44054.2e3, abs=50.0)
    assert APOGEE.start == pytest.approx(0.5 * APOGEE.period, rel=1e-15)


def test_a_mean_motion_and_the_semi_major_axis_of_it_give_the_same_orbit():
    low = Orbit(semi_major_axis=6713.137e3)
    assert low.mean_motion == pytest.approx(1.14783806e-3, rel=1e-8)
    assert low.period == pytest.approx(5473.93, abs=0.005)
    assert Orbit(mean_motion=low.mean_motion).semi_major_axis == pytest.approx(6713.137e3, rel=1e-14)
    both = Orbit(mean_motion=low.mean_motion, semi_major_axis=6713.137e3)
    assert both == low


@pytest.mark.parametrize("eccentricity", [0.0, 0.1, 0.471, 0.95])
def test_keplers_equation_gives_the_time_since_perigee(eccentricity):
    orbit = Orbit(mean_motion=1e-3, eccentricity=eccentricity, epoch=100.0, true_anomaly=1.9)
    eccentric = math.acos((eccentricity + math.cos(1.9)) / (1.0 + eccentricity * math.cos(1.9)))
    assert orbit.start == pytest.approx((eccentric - eccentricity * math.sin(eccentric)) / 1e-3 - 100.0)
    assert orbit.time_since_perigee(-1.9) == -orbit.time_since_perigee(1.9)
    assert orbit.time_since_perigee(1.9 - 2.0 * math.pi) == pytest.approx(orbit.time_since_perigee(1.9))


def test_lvlh_turns_fastest_at_perigee():
    """At the speed there over the radius, by the energy of the orbit."""
    radius = APOGEE.perigee_radius
    speed = math.sqrt(EARTH_MU * (2.0 / radius - 1.0 / APOGEE.semi_major_axis))
    assert APOGEE.fastest_rate == pytest.approx(speed / radius, rel=1e-14)
    assert Orbit(mean_motion=0.0011).fastest_rate == 0.0011


def test_a_spacecraft_takes_mean_motion_and_gravity_from_its_orbit():
    mars = Orbit(semi_major_axis=3800e3, eccentricity=0.05, gravitational_parameter=MARS_MU)
    craft = ORION.replace(orbit=mars)
    assert (craft.mean_motion, craft.gravitational_parameter) == (mars.mean_motion, MARS_MU)
    assert craft.reference_orbit is craft.orbit
    assert craft.replace(mass=30.0).orbit == mars
    assert craft.replace(orbit=APOGEE).mean_motion == APOGEE.mean_motion
    back = craft.replace(orbit=None)
    assert (back.orbit, back.gravitational_parameter) == (None, EARTH_MU)


def test_without_an_orbit_a_mean_motion_means_a_circular_one(tmp_path):
    assert ORION.orbit is None
    orbit = ORION.reference_orbit
    assert (orbit.mean_motion, orbit.is_circular, orbit.j2) == (0.0011, True, 0.0)
    save(ORION, tmp_path / "orion.toml")
    assert "[orbit]" not in (tmp_path / "orion.toml").read_text(encoding="utf-8")


@pytest.mark.parametrize(
    "orbit",
    [APOGEE, Orbit(mean_motion=0.0013, j2=EARTH_J2, planet_radius=EARTH_RADIUS * 0.9, inclination=1.7)],
    ids=["elliptic", "oblate"],
)
def test_a_spacecraft_with_an_orbit_comes_back_from_a_file_and_a_mapping_to_the_last_bit(orbit, tmp_path):
    craft = ORION.replace(orbit=orbit)
    save(craft, tmp_path / "craft.toml")
    assert load(tmp_path / "craft.toml") == craft
    assert load(craft.to_dict()) == craft


def test_an_orbit_table_goes_on_from_what_stands_above_it():
    """Mean motion and gravity of the spacecraft serve for an orbit that has none of its own."""
    above = ORION.to_dict() | {"mean_motion": 0.001, "gravitational_parameter": MARS_MU}
    craft = load(above | {"orbit": {"eccentricity": 0.02}})
    assert craft.orbit == Orbit(mean_motion=0.001, gravitational_parameter=MARS_MU, eccentricity=0.02)


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({}, "semi_major_axis (m) or mean_motion (rad/s) must be given, got neither"),
        ({"mean_motion": 0.0}, "semi_major_axis (m) or mean_motion (rad/s) must be given, got neither"),
        ({"mean_motion": 2.0}, "mean_motion must be from 1e-15 to 1 rad/s, got 2.0"),
        ({"semi_major_axis": -7e6}, "semi_major_axis must be a positive number of m, got -7000000.0"),
        ({"mean_motion": 1e-3, "eccentricity": 1.0}, "eccentricity must be from 0 to 0.99, got 1.0"),
        ({"mean_motion": 1e-3, "eccentricity": -0.1}, "eccentricity must be from 0 to 0.99, got -0.1"),
        ({"mean_motion": 1e-3, "inclination": 63.4}, "inclination must be from 0 to pi rad, got 63.4"),
        ({"mean_motion": 1e-3, "raan": 180.0}, "raan must be from -2 pi to 2 pi rad, got 180.0"),
        ({"mean_motion": 1e-3, "j2": 1e-3}, "planet_radius must be given beside j2, got j2 = 0.001 alone"),
        (
            {"semi_major_axis": 8e6, "eccentricity": 0.3, "planet_radius": EARTH_RADIUS},
            "its perigee must be outside the planet, at 6.37814e+06 m or more from its centre, got 5.6e+06 m",
        ),
        (
            {"semi_major_axis": 7e6, "mean_motion": 0.001},
            "mean_motion must be that of the semi_major_axis, 0.001078007612872506 rad/s, got 0.001; "
            "one of the two is enough",
        ),
        ({"mean_motion": 1e-3, "gravitational_parameter": 0.0}, "gravitational_parameter must be from 1e-15"),
        ({"mean_motion": math.inf}, "mean_motion must be from 1e-15 to 1 rad/s, got inf"),
        ({"mean_motion": 1e-3, "epoch": math.inf}, "epoch must be from -1e+09 to 1e+09 s, got inf"),
    ],
)  # fmt: skip
def test_an_orbit_that_cannot_be_is_refused_in_one_line(fields, message):
    with pytest.raises(ValueError, match=re.escape(message)) as refusal:
        Orbit(**fields)
    assert str(refusal.value).startswith(message)
    assert "\n" not in str(refusal.value)


@pytest.mark.parametrize(
    ("orbit", "message"),
    [
        ({"eccentricty": 0.1}, "spacecraft: orbit: unknown key 'eccentricty'; did you mean 'eccentricity'?"),
        ({"eccentricity": 1.5}, "spacecraft: orbit: eccentricity must be from 0 to 0.99, got 1.5"),
        ({"semi_major_axis": 8e6}, "spacecraft: mean_motion must be that of the orbit, "),
        (
            {"gravitational_parameter": 1e13},
            "spacecraft: gravitational_parameter must be that of the orbit, ",
        ),
        (5, "spacecraft: orbit: 5 is not a mapping of the fields of Orbit"),
    ],
)
def test_an_orbit_table_that_is_wrong_is_refused_in_one_line(orbit, message):
    with pytest.raises(ValueError, match=re.escape(message)) as refusal:
        load(ORION.to_dict() | {"orbit": orbit})
    assert str(refusal.value).startswith(message)


def test_another_mean_motion_beside_an_orbit_is_refused():
    with pytest.raises(
        ValueError, match="mean_motion must be left out beside an orbit, or be that of the orbit"
    ):
        ORION.replace(orbit=APOGEE).replace(mean_motion=0.002)
