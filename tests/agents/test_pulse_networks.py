"""Networks that see a whole pulse know its thrust for either cause, as well as its waveforms tell."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from thruster_agents.pulse_networks import PulseNetwork, PulseNetworkSettings, WaveformScores
from thruster_envs.physics.plasma_pulse import pulse_thrust, pulse_waveforms
from thruster_envs.spacecraft import load

CIRCUIT = load("ppt_cubesat").discharge
ERRORS = (4.0, 60.0)


@pytest.fixture(scope="module")
def pulses():
    """Healthy pulses and ones with less mass, measured; with the thrust for either cause."""
    rng = np.random.default_rng(4)
    share = np.where(np.arange(400) % 2, 1.0, rng.uniform(0.1, 1.0, 400))
    voltage = rng.uniform(857.0, 977.0, 400)
    waves = pulse_waveforms(CIRCUIT, slug_mass=share * CIRCUIT.slug_mass, voltage=voltage)
    measured = tuple(
        wave + error * rng.standard_normal(wave.shape)
        for wave, error in zip((waves.voltage, waves.current), ERRORS, strict=True)
    )
    by_mass = pulse_thrust(CIRCUIT, slug_mass=share * CIRCUIT.slug_mass, voltage=voltage)
    by_width = pulse_thrust(
        CIRCUIT, electrode_width=np.sqrt(share) * CIRCUIT.electrode_width, voltage=voltage
    )
    return measured, np.stack((by_mass, by_width), axis=1) / pulse_thrust(CIRCUIT)


def test_scores_have_errors_of_variance_one_and_keep_what_tells_pulses_apart(pulses):
    (voltage, current), _ = pulses
    scores = WaveformScores.of(voltage, current, ERRORS, 6)
    np.testing.assert_allclose(scores.directions @ scores.directions.T, np.eye(6), atol=1e-10)
    rng = np.random.default_rng(5)
    noise = (4.0 * rng.standard_normal((500, 3001)), 60.0 * rng.standard_normal((500, 3001)))
    spread = (scores(*noise) - scores(np.zeros((1, 3001)), np.zeros((1, 3001)))).std(axis=0)
    np.testing.assert_allclose(spread, 1.0, atol=0.15)
    whole = np.concatenate((voltage / 4.0, current / 60.0), axis=1).var(axis=0).sum()
    kept = scores(voltage, current).var(axis=0).sum()
    assert whole - kept < 1.05 * 6002  # what is left is errors


def test_a_network_knows_the_thrust_of_pulses_that_it_has_not_seen(pulses):
    (voltage, current), thrust = pulses
    scores = WaveformScores.of(voltage[:300], current[:300], ERRORS, 6)
    seen = scores(voltage, current)
    settings = PulseNetworkSettings(hidden=(12,), iterations=200)
    network = PulseNetwork(6, settings, generator=torch.Generator().manual_seed(0))
    network.train(seen[:300], np.log(thrust[:300]))
    error = network.predict(seen[300:]) / thrust[300:] - 1.0
    assert np.sqrt((error**2).mean(axis=0)).max() < 0.02


def test_a_network_declares_weak_pulses_faulty(pulses):
    (voltage, current), thrust = pulses
    seen = WaveformScores.of(voltage[:300], current[:300], ERRORS, 6)(voltage, current)
    faulty = thrust[:, 0] < 0.95
    settings = PulseNetworkSettings(asked="health", hidden=(8,), iterations=60)
    network = PulseNetwork(6, settings, generator=torch.Generator().manual_seed(0))
    network.train(seen[:300], faulty[:300].astype(np.float64))
    assert ((network.predict(seen[300:]) > 0.5) == faulty[300:]).mean() > 0.95


def test_the_same_seed_gives_the_same_network(pulses):
    (voltage, current), thrust = pulses
    seen = WaveformScores.of(voltage, current, ERRORS, 4)(voltage, current)
    answers = []
    for _ in range(2):
        network = PulseNetwork(
            4, PulseNetworkSettings(hidden=(4,), iterations=5), generator=torch.Generator().manual_seed(3)
        )
        network.train(seen, np.log(thrust))
        answers.append(network.predict(seen))
    np.testing.assert_array_equal(*answers)


def test_what_is_no_pulse_gets_its_line():
    with pytest.raises(ValueError, match=r"voltage has the shape \(3,\) and current \(3,\)"):
        WaveformScores.of(np.zeros(3), np.zeros(3), ERRORS)
    with pytest.raises(ValueError, match="there are 3 pulses; more than 8 would be right"):
        WaveformScores.of(np.zeros((3, 9)), np.zeros((3, 9)), ERRORS)
