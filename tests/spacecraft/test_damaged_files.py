"""Files that are no spacecraft: one line that names the file, whatever is wrong with it."""

import os
import random
import re
import tempfile
from importlib import resources
from pathlib import Path

import numpy as np
import pytest

from thruster_envs.spacecraft import catalogue, load, save

TEXTS = {
    name: (resources.files("thruster_envs.spacecraft") / "catalogue" / f"{name}.toml").read_text("utf-8")
    for name in catalogue()
}
ORION = TEXTS["orion"]


def refusal(path):
    """The error line of a file, without the file's name, which has to come first."""
    with pytest.raises(ValueError) as refused:  # noqa: PT011  # the text is checked by the caller
        load(path)
    text = str(refused.value)
    assert text.isprintable()  # above all no line break
    assert len(text) < 600
    assert text.startswith(f"{path}: ")
    return text.removeprefix(f"{path}: ")


def with_mass(text):
    return ORION.replace("mass = 20.0 ", f"mass = {text} ")


@pytest.mark.parametrize(
    "content",
    [
        b"\xef\xbb\xbf" + ORION.encode(),
        ORION.replace("\n", "\r\n").encode(),
        b"\xef\xbb\xbf" + ORION.replace("\n", "\r\n").encode(),
    ],
    ids=["byte-order mark", "lines of Windows", "both"],
)
def test_what_editors_of_windows_write_is_read(content, tmp_path):
    path = tmp_path / "mine.toml"
    path.write_bytes(content)
    assert load(path) == load("orion")


CONTENTS = {
    "UTF-16": (ORION.encode("utf-16"), "must be UTF-8 text, got UTF-16"),
    "UTF-16, big end first": (b"\xfe\xff" + ORION.encode("utf-16-be"), "must be UTF-8 text, got UTF-16"),
    "UTF-16 without a mark": (ORION.encode("utf-16-le"), "must be UTF-8 text, got a NUL byte in line 1"),
    "UTF-32": (ORION.encode("utf-32"), "must be UTF-8 text, got UTF-32"),
    "Latin-1": (
        ORION.replace('name = "orion"', 'name = "Orion n° 1"').encode("latin-1"),
        "must be UTF-8 text, got the byte 0xb0 in line 13",
    ),
    "NUL": (b"# one\nmass = \x00", "must be UTF-8 text, got a NUL byte in line 2"),
    "empty": (b"", "the key 'name' is missing"),
    "a picture": (b"\x89PNG\r\n\x1a\n", "must be UTF-8 text, got the byte 0x89 in line 1"),
    "large": (b"#" * 1_000_001, "must have at most 1,000,000 bytes, got more"),
    "key twice": (b"mass = 1\nmass = 2\n", "not a TOML file: Cannot overwrite a value (at line 2, column 9)"),
    "lists 500 deep": (f"mass = {'[' * 500}{']' * 500}".encode(), "nested too deep"),
    "tables 500 deep": (f"mass = {'{a = ' * 500}1{'}' * 500}".encode(), "nested too deep"),
    "keys 100,000 deep": (b"a." * 100_000 + b"a = 1", "nested too deep"),
    "keys 100 deep": (
        with_mass("1").replace("\n[feed]", "\n[feed]\n" + "a." * 100 + "a = 1").encode(),
        "feed: unknown key 'a'; known are coupling, propellant_mass",
    ),
    "key of a thousand letters": (b"m" * 1000 + b" = 1", f"unknown key '{'m' * 76}...; known are name, mass"),
    "whole number of 401 digits": (
        with_mass(10**400).encode(),
        f"mass must be within +/-1.8e+308, got 1{'0' * 76}...",
    ),
    "whole number of 5000 digits": (with_mass("9" * 5000).encode(), "Exceeds the limit (4300 digits)"),
    "hexadecimal of 5000 digits": (
        with_mass("0x" + "f" * 5000).encode(),
        "mass must be within +/-1.8e+308, got <int of 20000 bits>",
    ),
    "float that overflows": (with_mass("1e999").encode(), "the number 1e999 must be within +/-1.8e+308"),
    "float that overflows where inf may be": (
        ORION.replace("propellant_mass = inf ", "propellant_mass = 1e999 ").encode(),
        "the number 1e999 must be within +/-1.8e+308",
    ),
    "capacitor of 401 digits": (
        ORION.replace("[thruster_defaults]", f"[thruster_defaults]\ncapacitor = {10**400}").encode(),
        "thrusters, entry 1: capacitor must be a whole number of 64 bits, got 1000",
    ),
    "infinite": (with_mass("inf").encode(), "mass is inf; a positive number of kg would be right"),
    "no number": (with_mass("nan").encode(), "mass is NaN; a number would be right"),
    "date": (with_mass("2020-01-01").encode(), "mass is datetime.date(2020, 1, 1); a number would be right"),
    "time": (with_mass("07:32:00").encode(), "mass is datetime.time(7, 32); a number would be right"),
    "truth": (with_mass("true").encode(), "mass is True; a number would be right"),
    "text": (with_mass('"20 kg"').encode(), "mass is '20 kg'; a number would be right"),
    "list": (with_mass("[20.0]").encode(), "mass is [20.0]; a number would be right"),
    "mixed list": (
        ORION.replace("[0.575, 0.0, 0.0]", '[0.575, "0.0", [0.0]]').encode(),
        "inertia, entry 1, entry 2 is '0.0'; a number would be right",
    ),
    "flat list": (
        re.sub(r"inertia = \[.*?\n\]", "inertia = [1, 2, 3]", ORION, flags=re.DOTALL).encode(),
        "inertia, entry 1 is 1; a list would be right",
    ),
    "key of another table": (
        ORION.replace("[feed]", "[feed]\nmass = 20.0").encode(),
        "feed: unknown key 'mass'; known are coupling, propellant_mass",
    ),
    "tiny": (with_mass("1e-320").encode(), "mass must be from 1e-15 to 1e+15 kg, got 1e-320"),
    "huge": (with_mass("1e300").encode(), "mass must be from 1e-15 to 1e+15 kg, got 1e+300"),
}


@pytest.mark.parametrize(("content", "message"), CONTENTS.values(), ids=CONTENTS.keys())
def test_contents_that_are_no_spacecraft_are_refused_in_one_line(content, message, tmp_path):
    path = tmp_path / "mine.toml"
    path.write_bytes(content)
    assert message in refusal(path)


def test_only_regular_files_are_read(tmp_path):
    assert refusal(tmp_path) == "must be a regular file, got a folder"
    if hasattr(os, "mkfifo"):
        os.mkfifo(tmp_path / "pipe.toml")
        assert refusal(tmp_path / "pipe.toml") == "must be a regular file, got a pipe, socket or device"
        (tmp_path / "link.toml").symlink_to(tmp_path / "pipe.toml")
        assert refusal(tmp_path / "link.toml") == "must be a regular file, got a pipe, socket or device"
    if Path("/dev/zero").exists():
        assert refusal(Path("/dev/zero")) == "must be a regular file, got a pipe, socket or device"


def test_file_that_cannot_be_read_is_refused_with_the_systems_reason(tmp_path, monkeypatch):
    path = tmp_path / "mine.toml"
    path.write_text(ORION, encoding="utf-8")

    def locked(*_, **__):
        raise PermissionError(13, "Permission denied", str(path))

    monkeypatch.setattr("builtins.open", locked)  # root, who runs many a container, may read everything
    assert refusal(path) == "cannot be read: Permission denied"


def test_paths_that_cannot_be_are_refused_in_one_line(tmp_path):
    (tmp_path / "broken.toml").symlink_to(tmp_path / "nothing.toml")
    (tmp_path / "circle.toml").symlink_to(tmp_path / "circle.toml")
    for source in (
        "", "n" * 300, "n" * 300 + ".toml", tmp_path / ("n" * 300), "two\nlines.toml", "nul\0.toml",
        "a" * 10**6, tmp_path / "broken.toml", tmp_path / "circle.toml", ORION, Path("mass = 3\n"),
    ):  # fmt: skip
        with pytest.raises(ValueError, match=r"^there is no spacecraft .* and no such file; ") as refused:
            load(source)
        assert str(refused.value).isprintable()
        assert len(str(refused.value)) < 300
    for source in (b"orion", 10**5000, [[]], {"orion"}, np.zeros(3)):
        with pytest.raises(ValueError, match="a name, a path, a mapping or a Spacecraft would be right"):
            load(source)


def test_name_of_a_file_with_a_line_break_is_quoted(tmp_path):
    path = tmp_path / "two\nlines.toml"
    path.write_text("mass = 1", encoding="utf-8")
    with pytest.raises(ValueError, match=r"^'.*two\\nlines.toml': the key 'name' is missing$"):
        load(path)
    path.write_text(ORION, encoding="utf-8")
    assert load(path) == load("orion")


def test_text_that_no_file_can_hold_leaves_the_old_file(tmp_path):
    path = tmp_path / "mine.toml"
    save(load("orion"), path)
    with pytest.raises(ValueError, match="surrogates not allowed"):
        save(load("orion").replace(name="\udc80"), path)
    assert load(path) == load("orion")


TOKEN = re.compile(r'"[^"\n]*"|[A-Za-z_][\w.]*|[-+]?\d[\w.+-]*|\[\[|\]\]|[\[\]={},]|\n|#[^\n]*|\s+')
NUMBER = re.compile(r"[-+]?\d")
PIECES = [
    "nan", "inf", "-inf", "1e999", "0", "-1", "1" + "0" * 400, "9" * 5000, "0x" + "f" * 5000, "true", '"x"',
    "2020-01-01", "07:32:00", "1979-05-27T07:32:00Z", "[]", "{}", "[[]]", "[1, 2, 3]", "[" * 500 + "]" * 500,
    "{a=" * 300 + "1" + "}" * 300, "\0", "\ufeff", "\x85", "\r", "\r\n", '"' + "k" * 1000 + '"', "1e-320",
    "1e308", "5e-324", "1e15", "0.1", "3", "[1, 'a']", "'''a\nb'''", "a.b.c", "mass", "thrust", "[feed]",
    "[[thrusters]]", "[thruster_defaults]", "[modulator]", "[discharge]", "=", '""',
]  # fmt: skip


def damaged(chance):
    """A catalogue file with one to three changes."""
    tokens = TOKEN.findall(TEXTS[chance.choice(sorted(TEXTS))])
    numbers = [place for place, token in enumerate(tokens) if NUMBER.match(token)]
    for _ in range(chance.choice([1, 1, 1, 2, 3])):
        place, other = chance.randrange(len(tokens)), chance.randrange(len(tokens))
        change = chance.choice(["delete", "double", "replace", "copy", "exchange", "number"])
        if change == "delete":
            tokens[place] = ""
        elif change == "double":
            tokens[place] *= 2
        elif change == "replace":
            tokens[place] = chance.choice(PIECES)
        elif change == "copy":
            tokens[place] = tokens[other]
        elif change == "exchange":
            tokens[place], tokens[other] = tokens[other], tokens[place]
        else:
            tokens[chance.choice(numbers)] = chance.choice(PIECES)
    content = "".join(tokens).encode()
    if chance.random() < 0.1:
        place = chance.randrange(len(content))
        content = content[:place] + chance.randbytes(1) + content[place + chance.randrange(3) :]
    return content


@pytest.mark.parametrize("cases", [150, pytest.param(10_000, marks=pytest.mark.nightly)])
def test_damaged_files_are_refused_in_one_line_or_are_whole_spacecraft(cases):
    chance, refused = random.Random(cases), 0
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "damaged.toml"
        for _ in range(cases):
            path.write_bytes(damaged(chance))
            try:
                craft = load(path)
            except ValueError:
                refusal(path)
                refused += 1
                continue
            for numbers in (craft.effectiveness(), craft.authority(), craft.wrenches()):
                assert np.isfinite(numbers).all()
            assert load(craft.to_dict()) == craft
    assert 0.5 * cases < refused < 0.95 * cases
