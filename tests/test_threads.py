"""How many threads there are by default."""

from __future__ import annotations

import os

import pytest

from thruster_envs import threads


@pytest.fixture
def machine(monkeypatch):
    """Four processors this process may use, on two cores."""
    threads.physical_cores.cache_clear()
    monkeypatch.setattr(os, "sched_getaffinity", lambda process: {0, 1, 2, 3}, raising=False)
    yield lambda siblings: monkeypatch.setattr(threads, "_core", siblings)
    threads.physical_cores.cache_clear()


def test_a_core_counts_once_however_many_threads_of_hardware_it_has(machine):
    machine(lambda processor: f"{processor % 2},{processor % 2 + 2}")
    assert threads.physical_cores() == 2


def test_where_the_system_does_not_say_every_processor_is_a_core(machine):
    machine(str)
    assert threads.physical_cores() == 4


def test_this_machine_has_a_core_and_no_more_of_them_than_processors():
    threads.physical_cores.cache_clear()
    assert 1 <= threads.physical_cores() <= (os.cpu_count() or 1)
