"""TOML in and out."""

import re
import tomllib
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings

from tests.spacecraft.strategies import spacecraft
from thruster_envs.spacecraft import Thruster, catalogue, load, save

MINIMAL = """
name = "box"
mass = 4
inertia = [[3, 0, 0], [0, 2, 0], [0, 0, 4]]

[thruster_defaults]
thrust = 2.0
scatter = 0.1

[[thrusters]]
name = "a"
position = [0, 0.5, 0]
direction = [1, 0, 0]

[[thrusters]]
name = "b"
position = [0, -0.5, 0]
direction = [1, 0, 0]
scatter = 0.0
"""


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "box.toml"
    path.write_text(MINIMAL, encoding="utf-8")
    return path


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(craft=spacecraft())
def test_saved_spacecraft_load_back_to_the_last_bit(tmp_path, craft):
    path = tmp_path / "any.toml"
    save(craft, path)
    assert load(path) == craft
    assert dict(load(path).provenance) == dict(craft.provenance)


@pytest.mark.parametrize("name", catalogue())
def test_vehicles_of_the_catalogue_load_back_to_the_last_bit(name, tmp_path):
    save(load(name), tmp_path / "copy.toml")
    assert load(tmp_path / "copy.toml") == load(name)
    assert load(load(name)) == load(name)


def test_names_with_quotes_lines_and_control_characters_survive(tmp_path):
    odd = 'say "hi"\\ \n\t\x00\x7f\x85 é 🚀'
    craft = load("orion").replace(name=odd, provenance={odd: odd, "plain": ""})
    save(craft, tmp_path / "odd.toml")
    assert load(tmp_path / "odd.toml") == craft


def test_defaults_hold_for_the_thrusters_that_have_no_value_of_their_own(file):
    first, second = load(file).thrusters
    assert first == Thruster(name="a", position=(0, 0.5, 0), direction=(1, 0, 0), thrust=2.0, scatter=0.1)
    assert (second.thrust, second.scatter) == (2.0, 0.0)


def test_path_text_mapping_and_spacecraft_are_all_sources(file):
    by_path = load(file)
    assert load(str(file)) == by_path
    assert load(tomllib.loads(MINIMAL)) == by_path
    assert load(by_path) is by_path


def test_catalogue_has_free_flyers_a_chaser_and_a_cubesat():
    free_flyers = {"orion", "spheres", "astrobee_like", "atmos_like"}
    assert {*free_flyers, "msr_chaser", "ppt_cubesat"} <= set(catalogue())
    assert list(catalogue()) == sorted(catalogue())


def test_errors_name_the_file_and_the_place(file):
    file.write_text(MINIMAL.replace("position = [0, -0.5, 0]", "postion = [0, -0.5, 0]"), encoding="utf-8")
    with pytest.raises(ValueError) as refusal:  # noqa: PT011  # the text is checked below, in full
        load(file)
    assert (
        str(refusal.value) == f"{file}: thrusters, entry 2: unknown key 'postion'; did you mean 'position'?"
    )


def test_text_that_is_not_toml_is_refused_with_its_place(file):
    file.write_text("mass = = 4", encoding="utf-8")
    with pytest.raises(ValueError, match=r"box\.toml: not a TOML file: .*line 1"):
        load(file)


def test_defaults_that_are_no_table_are_refused(file):
    file.write_text(
        "thruster_defaults = 3\n" + MINIMAL.replace("[thruster_defaults]", "[feed]"), encoding="utf-8"
    )
    with pytest.raises(ValueError, match="thruster_defaults is 3; a table would be right"):
        load(file)


@pytest.mark.parametrize(
    ("source", "message"),
    [
        ("orionn", "did you mean 'orion'?"),
        ("nowhere/mine.toml", "a path that exists would be right"),
        (Path("mine.toml"), "a path that exists would be right"),
        (3, "a name, a path, a mapping or a Spacecraft would be right"),
        (None, "a name, a path, a mapping or a Spacecraft would be right"),
    ],
)
def test_sources_that_are_none_are_refused(source, message):
    with pytest.raises(ValueError, match=re.escape(message)):
        load(source)
