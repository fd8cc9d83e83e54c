"""Reaction wheels and control-moment gyros in a description: files, and what is refused."""

import pytest

from thruster_envs.spacecraft import ControlMomentGyro, ReactionWheel, load, save

WHEEL = {"name": "x", "axis": [2.0, 0.0, 0.0], "inertia": 2e-3, "max_torque": 5e-3, "max_speed": 500.0}
GYRO = {"name": "a", "gimbal_axis": [0.0, 0.0, 1.0], "spin_axis": [1.0, 0.0, 0.0], "momentum": 0.02,
        "max_gimbal_rate": 0.1}  # fmt: skip


def test_a_file_has_them_beside_the_thrusters(tmp_path):
    equipped = load("orion").replace(reaction_wheels=[WHEEL], control_moment_gyros=[GYRO])
    assert equipped.reaction_wheels[0] == ReactionWheel(**{**WHEEL, "axis": (1.0, 0.0, 0.0)})
    save(equipped, tmp_path / "equipped.toml")
    text = (tmp_path / "equipped.toml").read_text()
    assert text.count("[[reaction_wheels]]") == text.count("[[control_moment_gyros]]") == 1
    assert load(tmp_path / "equipped.toml") == equipped
    assert load(equipped.to_dict()) == equipped
    assert not load("orion").stores_momentum


@pytest.mark.parametrize(
    ("kind", "change", "message"),
    [
        (WHEEL, {"axis": [0.0, 0.0, 0.0]}, "reaction wheel 'x': axis"),
        (WHEEL, {"max_torque": 0.0}, "reaction wheel 'x': max_torque"),
        (
            WHEEL,
            {"initial_speed": 501.0},
            "initial_speed must be within the max_speed, 500.0 rad/s, got 501.0",
        ),
        (WHEEL, {"inertia": 0.6}, "the inertia must be that with all rotors held"),
        (WHEEL, {"speed": 1.0}, "speed"),
        (GYRO, {"spin_axis": [1.0, 0.0, 1.0]}, "spin_axis must be at right angles to the gimbal_axis"),
        (GYRO, {"momentum": -1.0}, "control-moment gyro 'a': momentum"),
    ],
)
def test_what_no_craft_has_is_refused_in_one_line(kind, change, message):
    name = "reaction_wheels" if kind is WHEEL else "control_moment_gyros"
    with pytest.raises(ValueError, match=message) as error:
        load("orion").replace(**{name: [kind | change]})
    assert "\n" not in str(error.value)


def test_two_of_one_name_are_refused():
    with pytest.raises(ValueError, match="reaction_wheels 1 and 2 are both named 'x'"):
        load("orion").replace(reaction_wheels=[WHEEL, WHEEL])


def test_a_gyro_keeps_its_axes_at_unit_length():
    gyro = ControlMomentGyro(**GYRO | {"spin_axis": (0.0, 3.0, 0.0)})
    assert gyro.spin_axis == (0.0, 1.0, 0.0)
