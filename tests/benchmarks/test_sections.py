"""Every section of the benchmarks runs; how fast anything is, is for the benchmarks to say."""

from __future__ import annotations

import importlib
import math

import pytest

from benchmarks.__main__ import SECTIONS, main, write
from benchmarks.report import AtLeast, AtMost, Row, Section, number
from benchmarks.timing import QUICK, race


@pytest.mark.filterwarnings("ignore::DeprecationWarning", "ignore::UserWarning")  # of the peers
@pytest.mark.parametrize("name", SECTIONS)
def test_a_section_measures_every_row_that_it_names(name):
    section = importlib.import_module(f"benchmarks.{name}").measure(QUICK)
    assert section.rows
    for row in section.rows:
        assert row.value is None or (math.isfinite(row.value) and row.value > 0.0)
        assert row.value is not None or "not installed" in row.note


def test_only_missed_targets_are_explained(tmp_path):
    rows = [
        Row("fast", 3.0, "steps/s", AtLeast(2.0), explain=lambda: "no need", charted=True),
        Row("slow", 1.0, "steps/s", AtLeast(2.0), explain=lambda: "here goes the time"),
        Row("so so", 1.5, "steps/s", AtLeast(2.0, bound=1.2)),
        Row("short", 1.0, "µs", AtMost(2.0)),
        Row("peer", None, "steps/s", note="not installed"),
    ]
    assert [row.verdict for row in rows] == ["met", "missed", "acceptable", "met", ""]
    text = write([Section("Title", "About.", rows)], tmp_path, QUICK).read_text(encoding="utf-8")
    assert "here goes the time" in text
    assert "no need" not in text
    assert "3 of 4 targets are reached. Missed: slow." in text
    assert (tmp_path / "speed.png").stat().st_size > 0


def test_a_race_compares_round_by_round():
    times = race({"one": lambda: sum(range(20_000)), "ten": lambda: sum(range(200_000))}, QUICK)
    assert len(times["one"].rounds) == QUICK.repetitions
    assert times["one"].times_faster_than(times["one"]) == 1.0
    assert times["ten"].times_faster_than(times["one"], own=10.0) == pytest.approx(
        10.0 * times["ten"].times_faster_than(times["one"])
    )


def test_an_unknown_section_is_refused_by_name(capsys):
    with pytest.raises(SystemExit):
        main(["enviroments"])
    assert "there is no section 'enviroments'" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("value", "text"),
    [(1234567.0, "1,230,000"), (61.26, "61.3"), (0.012345, "0.0123"), (0.0, "0"), (3.21e-9, "3.2e-9")],
)
def test_figures_have_three_digits(value, text):
    assert number(value) == text
