"""``thruster-envs warmup`` says what it compiles, and when there is nothing to do."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

from thruster_envs.commands import main


def test_a_second_warmup_has_nothing_to_do(capsys):
    assert main(["warmup", "PulseDiagnosis-v0"]) == 0
    assert "kernels" in capsys.readouterr().err
    assert main(["warmup", "thruster_envs/PulseDiagnosis-v0"]) == 0
    said = capsys.readouterr().err.splitlines()
    assert [line.partition("]")[2] for line in said[:-1]] == [
        " 0/3 PulseDiagnosis-v0, single (0 kernels compiled)",
        " 1/3 PulseDiagnosis-v0, batch of 8 (0 kernels compiled)",
        " 2/3 PulseDiagnosis-v0, large batch (0 kernels compiled)",
    ]
    assert said[-1].startswith("nothing was to be compiled")
    assert "kernels are kept in /" in said[-1]


@pytest.mark.parametrize(
    ("arguments", "line"),
    [
        (["PulseDiagnosis"], "got 'PulseDiagnosis'; did you mean 'PulseDiagnosis-v0'?"),
        (["--spacecraft", "orino"], "got 'orino'; did you mean 'orion'?"),
        (["OrionRendezvous-v1", "--spacecraft", "ppt_cubesatt"], "did you mean 'ppt_cubesat'?"),
        (["MarsRendezvous-v1", "--spacecraft", "orion"], "'orion' has no modulator"),
    ],
)
def test_what_cannot_be_warmed_up_is_refused_in_one_line(capsys, arguments, line):
    assert main(["warmup", *arguments]) == 2
    assert line in capsys.readouterr().err.splitlines()[-1]


def test_a_folder_that_cannot_be_written_is_named(capsys, monkeypatch, tmp_path):
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("THRUSTER_ENVS_CACHE_DIR", str(tmp_path / "file" / "kernels"))
    assert main(["warmup", "PulseDiagnosis-v0"]) == 1
    assert str(tmp_path / "file" / "kernels") in capsys.readouterr().err


@pytest.mark.nightly
def test_after_a_warmup_a_new_process_compiles_nothing(tmp_path):
    own = os.environ | {"THRUSTER_ENVS_CACHE_DIR": str(tmp_path)}
    warm = [sys.executable, "-m", "thruster_envs", "warmup", "PulseDiagnosis-v0"]
    first, second = (
        subprocess.run(warm, env=own, capture_output=True, text=True, check=True) for _ in range(2)
    )
    assert "kernels compiled in" in first.stderr.splitlines()[-1]
    assert second.stderr.splitlines()[-1].startswith("nothing was to be compiled")
