"""Descriptions with anything at all in the place of a value: one line, or a description that works."""

import copy
import dataclasses
import json
import math
import random
from decimal import Decimal
from fractions import Fraction
from typing import Any

import numpy as np
import pytest

from thruster_envs.faults import Fault, FaultDistribution, as_faults, decode, encode
from thruster_envs.spacecraft import Spacecraft, catalogue, load


class Text(str):
    """A text of another type."""


CIRCLE: list[Any] = []
CIRCLE.append(CIRCLE)
TABLE_OF_ITSELF: dict[str, Any] = {}
TABLE_OF_ITSELF["mass"] = TABLE_OF_ITSELF
DEEP: list[Any] = []
for _ in range(3000):
    DEEP = [DEEP]
VALUES = [
    None, True, False, 0, -1, 1, 2.5, math.nan, math.inf, -math.inf, 10**400, -(10**400), 10**5000, 1e-320,
    1e308, 1e16, -1e16, 1e-16, "", "x", "x\ny", Text("orion"), b"x", bytearray(b"abc"), [], (), {}, set(),
    CIRCLE, DEEP, TABLE_OF_ITSELF, np.array(3.0), np.array([1.0, 2.0, 3.0]), np.eye(3), np.eye(3) * 1j,
    np.zeros((2, 0)), np.array(None), np.array(["a"]), np.float32(1.0), np.float16(1e4), np.longdouble(1),
    np.int8(3), np.uint64(2**64 - 1), np.bool_(True), np.str_("y"), np.datetime64("2020-01-01"), object(),
    int, np.timedelta64(3, "s"), np.void(b"abc"), np.ma.masked, Decimal(1), Fraction(1, 3), 1j, range(3), ...,
    range(10**30), iter([1]), [1, [2]], "1.0", "nan", "\udc80", "\u2028", "x" * 10**5,
]  # fmt: skip

FAULT = json.loads(json.dumps(vars(Fault(1, "propellant_loss", severity=0.3, duration=5.0, onset=1.0))))
DISTRIBUTION = {
    "probability": 0.9, "kinds": {"loss": 1.0, "leak": 2.0}, "count": [1, 3], "onset": [1.0, 100.0],
    "duration": [5.0, 50.0], "severity": {"loss": [0.2, 0.4]}, "profiles": ["step", "ramp"],
    "thrusters": [2, 5], "profile_time": [2.0, 8.0], "dwell": [0.25, 0.75], "onset_grid": 5.0, "shared": True,
}  # fmt: skip
DESCRIPTIONS = [(load, json.loads(json.dumps(load(name).to_dict()))) for name in catalogue()]
DESCRIPTIONS += [(as_faults, one) for one in (FAULT, [FAULT, FAULT | {"profile": "sine"}], DISTRIBUTION)] * 2


def places(value, path=()):
    """The paths to everything in nested lists and mappings."""
    yield path
    for key, item in value.items() if isinstance(value, dict) else enumerate(value):
        if isinstance(item, dict | list):
            yield from places(item, (*path, key))
        else:
            yield (*path, key)


def spoiled(description, chance):
    """A copy with one value replaced or taken out, or another one put in."""
    result = copy.deepcopy(description)
    *way, last = chance.choice(list(places(description))[1:])
    parent = result
    for key in way:
        parent = parent[key]
    value, change = chance.choice(VALUES), chance.random()
    if change < 0.7:
        parent[last] = value
    elif change < 0.8:
        del parent[last]
    elif isinstance(parent, list):
        parent.append(value)
    else:
        parent[value if isinstance(value, str | int) else "x"] = value
    return result


def check(description):
    """Nothing that is accepted has a NaN in it, and it can be hashed, printed and read back."""
    assert hash(description) == hash(copy.deepcopy(description))
    each = description if isinstance(description, tuple) else (description,)
    assert "NaN" not in json.dumps([dataclasses.asdict(one) for one in each])
    assert repr(description)
    if isinstance(description, Spacecraft):
        for numbers in (description.effectiveness(), description.authority(), description.wrenches()):
            assert np.isfinite(numbers).all()
        assert load(description.to_dict()) == description
    elif isinstance(description, FaultDistribution):
        assert not np.isnan(description.encode()).any()
    elif all(fault.craft <= 3 and fault.thruster <= 12 for fault in description):
        rows = encode(description, 3, 12, slots=2)
        assert not np.isnan(rows).any()
        assert len(decode(rows)) == len(description)


@pytest.mark.parametrize("cases", [500, pytest.param(20_000, marks=pytest.mark.nightly)])
def test_odd_values_are_refused_in_one_line_or_do_no_harm(cases):
    chance, refused = random.Random(cases), 0
    for _ in range(cases):
        read, description = chance.choice(DESCRIPTIONS)
        try:
            accepted = read(spoiled(description, chance))
        except ValueError as refusal:
            assert str(refusal).isprintable()  # noqa: PT017  # most are refused, and some are not
            assert 10 < len(str(refusal)) < 700  # noqa: PT017
            refused += 1
            continue
        check(accepted)
    assert 0.5 * cases < refused < 0.99 * cases
