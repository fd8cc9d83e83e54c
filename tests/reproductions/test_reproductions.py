"""Reproductions run, and what is written is what came of them; how they came out is for the page to say."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from reproductions import registry
from reproductions.__main__ import RESULTS, main
from reproductions.figures import panels
from reproductions.record import FULL, QUICK, Effort, Finding, Reproduction, Table, Verdict
from reproductions.registry import chosen, find_all, fingerprint, order
from reproductions.results import entry_of, merge, read, render
from reproductions.running import run
from thruster_envs.kernels import sources_of

REGISTERED = find_all()


def toy(name: str = "T1", holds: bool = True, **more: object) -> Reproduction:
    def study(effort: Effort) -> Finding:
        return Finding(
            ours=f"{effort.samples} samples",
            checks={"it holds": holds},
            data={"samples": np.int64(effort.samples), "rates": np.array([0.5])},
            tables=(Table("A | B", ("a", "b"), (("1|2", "3"),)),),
            figure=lambda: panels()[0],
            **more,
        )

    return reproduction(name, study)


def toy_that_raises(name: str, error: BaseException) -> Reproduction:
    def study(effort: Effort) -> Finding:
        raise error

    return reproduction(name, study)


def reproduction(name: str, study: Callable[[Effort], Finding]) -> Reproduction:
    return Reproduction(
        id=name,
        title=f"Toy {name}",
        source="Nobody 1900",
        lines="L1",
        reported="7",
        criterion="it holds",
        run=study,
    )


@pytest.mark.parametrize("name", REGISTERED)
def test_a_reproduction_runs_in_quick_effort_and_can_be_kept(name, tmp_path):
    entry = entry_of(REGISTERED[name], QUICK, tmp_path)
    assert entry["verdict"] in list(Verdict)
    assert entry["ours"]
    assert (
        entry["reported"]
        or entry["verdict"] == Verdict.BEYOND_THE_SOURCE
        or not all(entry["checks"].values())
    )
    assert entry == json.loads(json.dumps(entry, allow_nan=False))
    if entry["figure"] is not None:
        assert (tmp_path / entry["figure"]).read_bytes().startswith(b"\x89PNG")
    assert entry["title"] in render({name: entry})


def test_the_page_is_what_the_recorded_results_render_to():
    assert (RESULTS / "reproductions.md").read_text(encoding="utf-8") == render(read(RESULTS))


def test_every_registered_result_is_on_record_and_no_other():
    recorded = read(RESULTS)
    assert list(recorded) == list(REGISTERED)
    for name, entry in recorded.items():
        assert entry["figure"] is None or (RESULTS / entry["figure"]).is_file(), name


def test_recorded_results_are_of_the_full_effort():
    efforts = [Effort(**entry["effort"]) for entry in read(RESULTS).values()]
    assert all(effort == FULL for effort in efforts)
    assert FULL.samples >= 10_000


@pytest.mark.parametrize(
    ("given", "verdict", "reason"),
    [
        ({}, Verdict.REPRODUCED, ""),
        ({"correction": "a sign"}, Verdict.WITH_A_CORRECTION, "a sign"),
        ({"not_reproducible": "no inputs"}, Verdict.NOT_REPRODUCIBLE, "no inputs"),
        ({"beyond_source": True}, Verdict.BEYOND_THE_SOURCE, ""),
        ({"holds": False, "correction": "a sign"}, Verdict.NOT_REPRODUCED, "it holds"),
        ({"holds": False, "beyond_source": True}, Verdict.NOT_REPRODUCED, "it holds"),
    ],
)
def test_the_verdict_follows_from_the_checks(given, verdict, reason):
    finding = toy(**given).run(QUICK)
    assert (finding.verdict, finding.reason) == (verdict, reason)


def test_a_finding_without_a_check_is_refused():
    with pytest.raises(ValueError, match="checks is empty"):
        Finding(ours="7", checks={}, data={})


def test_a_table_of_items_has_a_row_for_each_and_a_column_for_each_heading():
    made = Table.of("Sizes", {"a": 1.5, "b": 2.0}, {"": "{0}", "twice": lambda _, size: f"{2 * size:g}"})
    assert made == Table("Sizes", ("", "twice"), (("a", "3"), ("b", "4")))
    assert made == Table("Sizes", ["", "twice"], ([name, twice] for name, twice in made.rows))


def test_a_table_with_a_cell_too_few_is_refused():
    with pytest.raises(ValueError, match="row 2 of 'Rates' has 1 cells; 2 would be right"):
        Table("Rates", ("a", "b"), (("1", "2"), ("3",)))


def test_running_one_replaces_its_entry_and_keeps_the_others(tmp_path):
    run([toy("T10"), toy("T2")], QUICK, tmp_path)
    run([toy("T2", holds=False)], QUICK, tmp_path)
    recorded = read(tmp_path)
    assert list(recorded) == ["T2", "T10"]
    assert [entry["verdict"] for entry in recorded.values()] == ["not reproduced", "reproduced"]
    page = (tmp_path / "reproductions.md").read_text(encoding="utf-8")
    assert page == render(recorded)
    assert "2 results: 1 not reproduced, 1 reproduced." in page
    assert "**not reproduced**: it holds" in page
    assert "| 1\\|2 | 3 |" in page
    assert (tmp_path / "reproductions" / "T10.png").read_bytes().startswith(b"\x89PNG")


def test_resuming_runs_what_is_missing_changed_or_broke_off(tmp_path, capsys):
    assert (
        run([toy("T1"), toy_that_raises("T2", ZeroDivisionError("on purpose")), toy("T3")], QUICK, tmp_path)
        == 1
    )
    assert list(read(tmp_path)) == ["T1", "T3"]
    assert "ZeroDivisionError: on purpose" in capsys.readouterr().out

    assert run([toy("T1"), toy("T2"), toy("T3")], QUICK, tmp_path, resume=True) == 0
    assert "2 of 3 are recorded already" in capsys.readouterr().out
    assert list(read(tmp_path)) == ["T1", "T2", "T3"]

    run([toy("T1"), toy("T2")], Effort(samples=7), tmp_path, resume=True)
    ours = [entry["ours"] for entry in read(tmp_path).values()]
    assert ours == ["7 samples", "7 samples", f"{QUICK.samples} samples"]


def test_a_stopped_run_keeps_what_was_finished(tmp_path):
    stopping = toy_that_raises("T2", KeyboardInterrupt())
    assert run([toy("T1"), stopping, toy("T3")], QUICK, tmp_path) == 130
    assert list(read(tmp_path)) == ["T1"]


def test_the_fingerprint_changes_with_the_effort_and_with_what_is_said():
    one = toy("T1")
    assert fingerprint(one, QUICK) == fingerprint(toy("T1"), QUICK)
    assert len({fingerprint(one, QUICK), fingerprint(one, FULL), fingerprint(toy("T2"), QUICK)}) == 3


def test_the_fingerprint_sees_the_code_under_a_study_and_not_its_words(monkeypatch):
    def printed(change):
        monkeypatch.setattr(registry, "sources_of", lambda *_: sources | change)
        registry._code_under.cache_clear()
        return fingerprint(one, QUICK)

    one = find_all()["E20"]
    sources = sources_of("reproductions.yang2003.section_6_3_nominal_firing")
    core = sources["thruster_baselines.mapping.simplex"]
    assert b'"""' in core
    before = printed({})
    assert (
        printed({"thruster_baselines.mapping.simplex": b"# said\n" + core.replace(b'"""', b'"""Or: ', 1)})
        == before
    )
    assert printed({"thruster_baselines.mapping.simplex": core + b"\nNEW = 1\n"}) != before
    registry._code_under.cache_clear()


def test_an_unknown_id_gets_one_line_that_names_the_nearest(capsys):
    assert main(["run", "E200"]) == 2
    assert capsys.readouterr().err == "there is no reproduction 'E200'; the nearest is E20\n"


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "not JSON: Expecting value: line 1 column 1"),
        (b'{"T1": {"id"', "not JSON: "),
        (b"[" * 100_000, "not JSON: "),
        ("{}".encode("utf-16"), "must be UTF-8 text, got UTF-16"),
        (b"[]", "must be results as `python -m reproductions run` writes them"),
        (b'{"T1": {"id": "T1"}}', "must be results as `python -m reproductions run` writes them"),
    ],
    ids=["empty", "half", "deep", "UTF-16", "a list", "an entry that lacks something"],
)
def test_damaged_results_get_one_line_before_any_work(content, message, tmp_path, capsys):
    path = tmp_path / "reproductions.json"
    path.write_bytes(content)
    for command in (["run", "E20", "--quick"], ["list"]):
        assert main([*command, "--output", str(tmp_path)]) == 2
        said = capsys.readouterr()
        assert said.err.startswith(f"{path}: {message}")
        assert said.err.count("\n") == 1
        assert said.out == ""
    assert path.read_bytes() == content


def test_output_that_is_a_file_gets_one_line_before_any_work(tmp_path, capsys):
    (tmp_path / "file").write_text("mine", encoding="utf-8")
    for folder in (tmp_path / "file", tmp_path / "file" / "below", tmp_path / ("n" * 300)):
        assert main(["run", "E20", "--quick", "--output", str(folder)]) == 2
        said = capsys.readouterr()
        assert said.err.startswith(f"{folder}: cannot be written in: ")
        assert said.err.count("\n") == 1
        assert said.out == ""
    assert (tmp_path / "file").read_text(encoding="utf-8") == "mine"


def test_ids_are_run_in_order_and_once():
    assert [one.id for one in chosen(["E22", "E20", "E22"], REGISTERED)] == ["E20", "E22"]
    assert [one.id for one in chosen(["all"], REGISTERED)] == sorted(REGISTERED, key=order)


def test_two_processes_give_what_one_gives(tmp_path):
    those = chosen(["E20", "E21"], REGISTERED)
    run(those, QUICK, tmp_path / "one")
    run(those, QUICK, tmp_path / "two", processes=2)
    assert read(tmp_path / "one") == read(tmp_path / "two")


def test_a_quick_run_writes_nothing(monkeypatch, tmp_path):
    monkeypatch.setattr("reproductions.__main__.RESULTS", tmp_path)
    assert main(["run", "E20", "--quick"]) == 0
    assert not list(Path(tmp_path).iterdir())


def test_the_list_says_what_is_on_record(capsys, tmp_path):
    merge([entry_of(REGISTERED["E20"], QUICK, None)], tmp_path)
    main(["list", "--output", str(tmp_path)])
    lines = {line.split()[0]: line for line in capsys.readouterr().out.splitlines()}
    assert lines["E20"].endswith(": reproduced (by other settings or older code)")
    assert lines["E21"].endswith(": not run yet")
