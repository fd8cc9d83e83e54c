"""Frozen configurations and the plain mappings that they travel as."""

import dataclasses
import enum
import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
import pytest

from thruster_envs.configuration import coerce_fields, from_mapping, shown, to_mapping


@dataclass(frozen=True)
class Inner:
    size: float
    label: str = ""


@dataclass(frozen=True, kw_only=True)
class Outer:
    count: int
    mode: Literal["fast", "slow"] = "fast"
    inner: Inner = field(default_factory=lambda: Inner(1.0))
    many: tuple[Inner, ...] = ()
    pair: tuple[int, float] = (1, 2.0)
    named: Mapping[str, Inner] = field(default_factory=dict)
    limit: float | None = None
    anything: Any = None
    switch: bool = False

    def __post_init__(self) -> None:
        coerce_fields(self)


FULL = Outer(
    count=3,
    mode="slow",
    inner=Inner(2.0, "x"),
    many=(Inner(1.0), Inner(float("inf"))),
    pair=(4, 5.0),
    named={"a": Inner(7.0)},
    limit=0.5,
    switch=True,
)


def test_configurations_survive_json():
    assert from_mapping(Outer, json.loads(json.dumps(to_mapping(FULL)))) == FULL
    assert from_mapping(Outer, to_mapping(Outer(count=1))) == Outer(count=1)


def test_configuration_is_its_own_mapping():
    assert from_mapping(Outer, FULL) is FULL
    assert from_mapping(Outer, {"count": 1, "inner": Inner(3.0)}).inner == Inner(3.0)


def test_loose_values_become_what_the_fields_declare():
    loose = Outer(count=np.int64(3), pair=[1.0, 2], limit=np.float32(0.5), many=[{"size": 1}])
    assert loose == Outer(count=3, pair=(1, 2.0), limit=0.5, many=(Inner(1.0),))
    assert [type(value) for value in (loose.count, *loose.pair, loose.limit)] == [int, int, float, float]


class Speed(enum.StrEnum):
    """A mode as a member of an enumeration."""

    SLOW = "slow"


class Size(enum.IntEnum):
    """A whole number as a member of an enumeration."""

    LARGE = 3


def test_fields_hold_pythons_own_types_whatever_gave_them():
    loose = Outer(
        count=Size.LARGE,
        mode=Speed.SLOW,
        inner={"size": np.array(2.0), "label": np.str_("x")},
        pair=np.array([4, 5]),
        named={Speed.SLOW: Inner(7.0)},
        limit=np.longdouble(0.5),
        switch=np.bool_(True),
    )
    assert loose == Outer(
        count=3, mode="slow", inner=Inner(2.0, "x"), pair=(4, 5.0), named={"slow": Inner(7.0)},
        limit=0.5, switch=True,
    )  # fmt: skip
    assert (type(loose.count), type(loose.mode), type(loose.limit)) == (int, str, float)
    assert [type(key) for key in loose.named] == [str]
    assert "Speed" not in repr(loose)


def test_values_are_shown_on_one_short_line():
    assert shown("a\nb") == r"'a\nb'"
    assert shown(np.zeros((2, 2))) == "array([[0., 0.], [0., 0.]])"
    assert shown(10**100) == "1" + "0" * 76 + "..."
    assert shown(-(10**5000)) == "<int of 16610 bits>"
    assert shown([10**5000]) == "<list that cannot be printed>"
    assert shown({"a": 10**5000}) == "<dict that cannot be printed>"


@dataclass(frozen=True)
class Either:
    some: tuple[str, ...] | Mapping[str, float]

    def __post_init__(self) -> None:
        coerce_fields(self)


@pytest.mark.parametrize(
    ("value", "message"),
    [
        (["a", 3], r"^some, entry 2 is 3; a value of type str would be right$"),
        ({"a": "b"}, r"^some, 'a' is 'b'; a number would be right$"),
        (3, r"^some is 3; a list would be right$"),
    ],
)
def test_of_two_types_the_error_is_about_the_one_that_was_meant(value, message):
    with pytest.raises(ValueError, match=message):
        Either(value)


@pytest.mark.parametrize(
    ("mapping", "message"),
    [
        ({"count": 10**30}, r"^file: count must be a whole number of 64 bits, got 1000"),
        ({"count": 1, "pair": range(10**30)}, r"^file: pair must have at most 1,000,000 entries, got range"),
        ({"count": 1, "pair": range(3)}, r"^file: pair has 3 entries; 2 would be right$"),
        ({"count": 1e300}, r"^file: count must be a whole number of 64 bits, got 1000"),
        ({"count": 1, "limit": -(10**400)}, r"^file: limit must be within \+/-1\.8e\+308, got -1000"),
        ({"count": 1, "named": {10**5000: {}}}, r"^file: named, key <int of 16610 bits> is <int of 16610"),
        ({"count": 1, "moed": "fast"}, r"^file: unknown key 'moed'; did you mean 'mode'\?$"),
        ({}, r"^file: the key 'count' is missing$"),
        ({"count": 1.5}, r"^file: count is 1\.5; a whole number would be right$"),
        ({"count": 1, "mode": "fats"}, r"^file: mode: 'fats' is unknown; did you mean 'fast'\?$"),
        ({"count": 1, "inner": {"sise": 1}}, r"^file: inner: unknown key 'sise'; did you mean 'size'\?$"),
        (
            {"count": 1, "many": [{"size": 1}, {"size": "big"}]},
            r"^file: many, entry 2: size is 'big'; a number",
        ),
        ({"count": 1, "many": {"size": 1}}, r"^file: many is \{'size': 1\}; a list would be right$"),
        ({"count": 1, "pair": [1]}, r"^file: pair has 1 entries; 2 would be right$"),
        ({"count": 1, "named": [1]}, r"^file: named is \[1\]; a table of keys and values would be right$"),
        ({"count": 1, "named": {"a": {}}}, r"^file: named, 'a': the key 'size' is missing$"),
        ({"count": 1, "named": {3: {}}}, r"^file: named, key 3 is 3; a value of type str would be right$"),
        ({"count": 1, "limit": "x"}, r"^file: limit is 'x'; a number would be right$"),
        ({"count": 1, "switch": 1}, r"^file: switch is 1; a value of type bool would be right$"),
        (["count", 1], r"^file: \['count', 1\] is not a mapping of the fields of Outer$"),
    ],
)
def test_wrong_mappings_are_refused_with_their_place(mapping, message):
    with pytest.raises(ValueError, match=message):
        from_mapping(Outer, mapping, where="file")


def test_long_values_are_shortened_in_errors():
    with pytest.raises(ValueError, match=r"^count is 'x{70,80}\.\.\.; a whole number would be right$"):
        Outer(count="x" * 1000)


def test_only_configurations_become_mappings():
    assert to_mapping(Inner(1.0)) == dataclasses.asdict(Inner(1.0))
    for wrong in (Inner, {"size": 1.0}):
        with pytest.raises(ValueError, match="a dataclass instance would be right"):
            to_mapping(wrong)
