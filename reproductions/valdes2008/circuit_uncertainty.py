"""What becomes of the thrust that waveforms give, if the circuit is not known exactly.

Everything in the fair comparison knows the nominal circuit, of which its pulses are. Here capacitance,
inductance and resistance scatter, all by the same share; pulses are of any cause or none, and the cause is
given, as the motion would. Nothing is calibrated again.
"""

from __future__ import annotations

import dataclasses
import itertools
from dataclasses import dataclass
from functools import partial

import numpy as np

from reproductions.cells import spread
from reproductions.figures import BLUE, GREEN, Figure, dots, panels
from reproductions.record import Effort, Finding, Table
from reproductions.valdes2008 import reproduces
from reproductions.valdes2008.fair_comparison_study import drawn_pulses, fit, pulse_networks, scores
from reproductions.valdes2008.low_level_study import seeds_of
from reproductions.valdes2008.study import CIRCUIT, NOMINAL_THRUST, measured, out_of_band
from thruster_envs.physics.plasma_pulse import pulse_thrust
from thruster_envs.protocols import FloatArray
from thruster_envs.seeds import TEST

SCATTERS = (0.0, 0.003, 0.01, 0.03)
PULSES = 25  # of each circuit


@dataclass(frozen=True)
class Errors:
    """Of the pulses of many circuits."""

    fitted: float  # Root mean square of the error of the thrust over nominal, by the fitted circuit
    networks: tuple[float, ...]  # the same, for the network of each seed
    fitted_wrong: float  # share of pulses put on the wrong side of the band by the fitted circuit
    networks_wrong: tuple[float, ...]  # the same, for the network of each seed


def errors_of(scatter: float, circuits: int, seeds: int) -> Errors:
    """Measure pulses of circuits that scatter by this standard deviation."""
    rng = np.random.default_rng(TEST.start + 105)
    truth, found = [], []
    for _ in range(circuits):
        share = 1.0 + scatter * rng.standard_normal(3)
        circuit = dataclasses.replace(
            CIRCUIT,
            capacitance=CIRCUIT.capacitance * share[0],
            inductance=CIRCUIT.inductance * share[1],
            resistance=CIRCUIT.resistance * share[2],
        )
        parameters, _ = drawn_pulses(rng, PULSES)
        width = parameters["electrode_width"] < CIRCUIT.electrode_width
        pulses = measured(rng, circuit, **parameters)
        estimate, seen = fit()(*pulses), scores()(*pulses)
        estimated = [np.where(width, estimate.thrust_if_width, estimate.thrust_if_mass)]
        for network in pulse_networks(seeds, "thrust"):
            by_mass, by_width = network.predict(seen).T
            estimated.append(np.where(width, by_width, by_mass))
        truth.append(pulse_thrust(circuit, **parameters) / NOMINAL_THRUST)
        found.append(np.stack(estimated))
    thrust, said = np.concatenate(truth), np.concatenate(found, axis=1)
    error: FloatArray = np.sqrt(((said - thrust) ** 2).mean(axis=1))
    wrong = (out_of_band(said) != out_of_band(thrust)).mean(axis=1)
    return Errors(float(error[0]), tuple(error[1:]), float(wrong[0]), tuple(wrong[1:]))


@reproduces(
    "plasma-circuit-uncertainty",
    lines="beside section 6.4, L2187-2199",
    reported="",
    criterion="within 0.5 % if the circuit is known; the error for circuits that scatter is shown",
)
def uncertainty(effort: Effort) -> Finding:
    """The thrust that waveforms tell if the circuit is not known exactly."""
    circuits, seeds = max(2, effort.flights), seeds_of(effort)
    found = {scatter: errors_of(scatter, circuits, seeds) for scatter in SCATTERS}
    percent = {at: (100.0 * one.fitted, 100.0 * np.array(one.networks)) for at, one in found.items()}
    wrong = {
        at: (100.0 * one.fitted_wrong, 100.0 * np.array(one.networks_wrong)) for at, one in found.items()
    }
    table = Table.of(
        "Median and range of the seeds",
        SCATTERS,
        {
            "scatter of capacitance, inductance, resistance": "{0:.1%}",
            "error, fitted circuit": lambda one: f"{percent[one][0]:.2f} %",
            "error, networks": lambda one: f"{spread(percent[one][1], '.2f')} %",
            "wrongly judged, fitted circuit": lambda one: f"{wrong[one][0]:.1f} %",
            "wrongly judged, networks": lambda one: f"{spread(wrong[one][1], '.1f')} %",
        },
    )
    return Finding(
        ours="error of the thrust, fitted circuit and networks: "
        + "; ".join(f"{scatter:.1%} scatter {a:.2f} and {spread(b, '.2f')} %"
                    for scatter, (a, b) in percent.items()),
        checks={
            "known exactly, the thrust is told within 0.5 %": max(*percent[0.0][:1], *percent[0.0][1]) < 0.5,
            "the error grows with the scatter": all(
                found[a].fitted < found[b].fitted for a, b in itertools.pairwise(SCATTERS)
            ),
        },
        beyond_source=True,
        data={f"{scatter:g}": dataclasses.asdict(one) for scatter, one in found.items()},
        note=f"{circuits} circuits of {PULSES} pulses each; {seeds} networks. Errors are root mean squares, "
        "in percent of nominal thrust; judged is whether the thrust is within 15 %.",
        tables=(table,),
        figure=partial(_draw, percent, wrong),
    )  # fmt: skip


def _draw(
    percent: dict[float, tuple[float, FloatArray]], wrong: dict[float, tuple[float, FloatArray]]
) -> Figure:
    figure, axes = panels(2, height=3.6)
    what = ("error of the thrust (% of nominal)", "pulses wrongly judged (%)")
    for axis, values, label in zip(axes, (percent, wrong), what, strict=True):
        axis.plot([one[0] for one in values.values()], "s-", color=BLUE, label="circuit fitted")
        for x, (_, networks) in enumerate(values.values()):
            dots(axis, x, networks, GREEN, label=None if x else "networks, a dot a seed")
        axis.set_xticks(range(len(values)), [f"{100 * one:g}" for one in values])
        axis.set(xlabel="scatter of the circuit (%)", ylabel=label)
    axes[0].legend(loc="upper left")
    return figure
