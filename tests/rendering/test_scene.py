"""A scene that cannot be drawn is refused in one line, where it is made."""

import numpy as np
import pytest

from thruster_envs.rendering import CraftScene, Curve, Scene
from thruster_envs.spacecraft import load

ORION = load("orion")
GOOD = {
    "attitude": (1.0, 0.0, 0.0, 0.0),
    "duties": np.zeros(12),
    "thrust": np.zeros(12),
    "faulty": np.zeros(12),
}


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"attitude": (1.0, 0.0, 0.0)}, r"attitude has shape \(3,\), it must be \(4,\)"),
        ({"attitude": np.zeros(4)}, "must be a quaternion"),
        ({"thrust": np.zeros(11)}, r"thrust has shape \(11,\), it must be \(12,\)"),
        ({"faulty": np.zeros(11)}, r"faulty has shape \(11,\), it must be \(12,\)"),
        ({"shut": np.zeros(11)}, r"shut has shape \(11,\), it must be \(12,\)"),
        ({"position": (0.0, np.nan, 0.0)}, "position is .*nan.*finite"),
        ({"target": (0.0, np.inf, 0.0)}, "target is .*inf.*finite"),
        ({"path": np.zeros((5, 2))}, r"path has shape \(5, 2\), it must be \(5, 3\)"),
        ({"path": 1.0}, r"path has shape \(\), it must be \(0, 3\)"),
    ],
)
def test_a_craft_that_does_not_fit_is_refused(changes, message):
    with pytest.raises(ValueError, match=message) as error:
        CraftScene(**(GOOD | changes))
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"craft": ()}, "at least one CraftScene"),
        (
            {"spacecraft": ORION.replace(thrusters=ORION.thrusters[:7])},
            "number 1 has 12 duties, it must have 7",
        ),
        ({"time": np.nan}, "time is nan"),
        ({"corridor": np.zeros((2, 3))}, r"Scene.corridor has shape \(2, 3\), it must be \(2, 2\)"),
        ({"corridor": [(0.0, np.inf)]}, "Scene.corridor is .*inf.*finite"),
        ({"bars": (("x", 0.0, np.nan),)}, "nan.*'x'.*finite"),
    ],
)
def test_a_scene_that_does_not_fit_is_refused(changes, message):
    values = {"spacecraft": ORION, "craft": (CraftScene(**GOOD),), "time": 0.0, "title": ""}
    with pytest.raises(ValueError, match=message):
        Scene(**(values | changes))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"measured": np.zeros(4)}, r"Curve.measured has shape \(4,\), it must be \(5,\)"),
        ({"expected": np.full(5, np.inf)}, "Curve.expected is .*inf.*finite"),
        ({"time": np.zeros(1)}, r"Curve.time has shape \(1,\), it must be \(2,\)"),
    ],
)
def test_a_curve_that_does_not_fit_is_refused(changes, message):
    values = {
        "label": "",
        "time_label": "",
        "time": np.arange(5.0),
        "expected": np.zeros(5),
        "measured": np.zeros(5),
    }
    with pytest.raises(ValueError, match=message):
        Curve(**(values | changes))


def test_a_craft_keeps_copies():
    duties = np.zeros(12)
    craft = CraftScene(**(GOOD | {"duties": duties}))
    duties[:] = 1.0
    assert not craft.duties.any()
