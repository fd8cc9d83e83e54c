"""Frozen configurations and the plain mappings that they travel as."""

import dataclasses
import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
import pytest

from thruster_envs.configuration import coerce_fields, from_mapping, to_mapping


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


@pytest.mark.parametrize(
    ("mapping", "message"),
    [
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
