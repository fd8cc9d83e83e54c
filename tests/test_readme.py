"""What the README shows works when pasted, and what it states is what the tests hold the suite to."""

import json
import re
import shutil
from importlib.resources import files
from pathlib import Path

from tests.agents.test_score import STATED_SCORE, STATED_WAY
from tests.own_task import FIRST_LINE, blocks, write_own_task

README = Path(__file__).parents[1] / "README.md"
RECORD = README.parent / "docs" / "results" / "reproductions.json"


def test_its_examples_run_as_they_stand(tmp_path, monkeypatch, capsys):
    catalogue = files("thruster_envs.spacecraft").joinpath("catalogue", "orion.toml")
    shutil.copy(str(catalogue), tmp_path / "mine.toml")
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    write_own_task(tmp_path)
    examples = [block for block in blocks() if not block.startswith(FIRST_LINE)]
    assert len(examples) == 10
    for block in examples:
        exec(compile(block, str(README), "exec"), {})  # the user's paste, each of them alone
    printed = capsys.readouterr().out
    assert "4.5" in printed
    assert "4.065" in printed
    assert (
        "[5]\nthe rate change of vehicle 0, velocity x, is nan; a finite number of m/s would be right"
        in printed
    )
    assert "30.0 s  named: thruster 6, stuck_off" in printed
    lines = printed.splitlines()
    approach = next(k for k, line in enumerate(lines) if re.fullmatch(r"6\d\.\d s  alarm: .*", line))
    score, declared = lines[approach - 2 : approach]
    assert float(score) > 0.8
    thrusters, first = re.fullmatch(r"\{(.*)\} (\d+)", declared).groups()
    assert thrusters == "1"
    assert 400 <= int(first) < 1000
    *decisions, end, spread, lengths, shape = lines[approach:]
    assert shape == "(4, 15)"
    assert abs(float(spread) - 0.05 / 3.0**0.5) < 0.002  # of a uniform rate of 1,000 worlds
    assert lengths == "[40 40 40]"
    assert any(re.fullmatch(r"6\d\.\d s  identified: thruster 3, stuck_on", line) for line in decisions)
    assert "branch B" in decisions[-1]
    assert end == "captured"


def test_it_states_the_score_that_training_is_held_to():
    text = README.read_text()
    assert f"at least {STATED_SCORE}" in text
    for share in STATED_WAY.values():
        assert f"{100 * share:g} %" in text


def test_its_table_of_the_mars_chaser_is_the_one_on_record():
    found, *_ = json.loads(RECORD.read_text(encoding="utf-8"))["mars-recovery"]["tables"]
    head, _, *rows = re.search(r"\| pilot \|.*?\n\n", README.read_text(), re.DOTALL).group().split("\n")[:-2]
    columns = _cells(head)
    assert {"detected", "right thruster", "false alarms", "captured", "missed or lost"} <= set(columns)
    on_record = [[row[found["head"].index(column)] for column in columns] for row in found["rows"]]
    assert [_cells(row) for row in rows] == on_record


def test_its_pictures_and_pages_are_there():
    for target in re.findall(r"\]\(((?:docs|src)/[^)]+|[A-Z]+\.cff)\)", README.read_text()):
        path, _, anchor = target.partition("#")
        assert (README.parent / path).exists(), target
        assert not anchor or f'id="{anchor}"' in (README.parent / path).read_text(encoding="utf-8"), target


def _cells(line):
    return [cell.strip() for cell in line.strip("|").split("|")]
