"""Many sampled runs of one scenario at once, from arrays of what differs between them."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dvs_common.arrays import FloatArray
from dvs_common.errors import ParameterError
from dvs_common.scenario.model import PlantModel
from dvs_common.scenario.scenario import Scenario
from dvs_common.wire.messages import parse_command, parse_state
from dvs_common.wire.topics import COMMAND, STATE
from dvs_hinf_controller.design.design import Design
from dvs_simulation.sampled.compiled_loop import compiled_loop
from dvs_simulation.sampled.conditions import Conditions
from dvs_simulation.sampled.sampled_loop import run_by_messages


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ManyRuns:
    """Outcome of K runs of N periods.

    Parameters
    ----------
    states
        x at every sample, shape (K, N + 1, n); NaN from the first luminosity that is not positive.
    commands
        u_o that answers every sample, shape (K, N + 1, m); where the packet was lost, and after
        a luminosity that is not positive, zero.
    samples
        Samples before a luminosity that is not positive, N + 1 where none did, shape (K,).
    compiled
        Whether compiled code ran it, shape (K,); the numbers are the same.
    """

    states: FloatArray
    commands: FloatArray
    samples: NDArray[np.int64]
    compiled: NDArray[np.bool_]


def run_many(
    scenario: Scenario,
    design: Design,
    *,
    initial_states: FloatArray,
    first_references: FloatArray | None = None,
    disturbances: FloatArray | None = None,
    latencies_ns: NDArray[np.int64] | None = None,
    lost: NDArray[np.bool_] | None = None,
    plants: list[PlantModel] | None = None,
) -> ManyRuns:
    """Run a scenario K times.

    Parameters
    ----------
    scenario
        What the runs have in common.
    design
        Their controller.
    initial_states
        x(0), shape (K, n).
    first_references
        ``|q(0)|``, shape (K, r); None for those of the scenario.
    disturbances
        Added to the input in every period, shape (K, N, m).
    latencies_ns
        Time from a sample to the moment its command acts, ns, shape (K, N + 1).
    lost
        Samples whose packet is lost, shape (K, N + 1).
    plants
        The true plants, K of them.

    Raises
    ------
    ParameterError
        If the numbers of runs differ, or a run's conditions do not fit.
    """
    given = {
        'first_reference': first_references,
        'disturbance': disturbances,
        'latencies_ns': latencies_ns,
        'lost': lost,
        'plant': plants,
    }
    count = len(initial_states)
    for name, array in given.items():
        if array is not None and len(array) != count:
            plural = name if name in ('lost', 'latencies_ns') else f'{name}s'
            raise ParameterError(plural, len(array), f'must be those of {count} runs')
    size, model = scenario.sample_count + 1, scenario.model
    result = ManyRuns(
        states=np.full((count, size, model.state_count), math.nan),
        commands=np.zeros((count, size, model.input_count)),
        samples=np.full(count, size),
        compiled=np.ones(count, bool),
    )
    loop = compiled_loop(scenario, design)
    for i, start in enumerate(initial_states):
        conditions = Conditions(
            initial_state=start,
            **{name: array[i] for name, array in given.items() if array is not None},  # type: ignore[arg-type]
        )
        run = None if loop is None else loop.run(conditions)
        if run is None:
            result.compiled[i] = False
            result.samples[i] = _by_messages(scenario, design, conditions, result, i)
        else:
            result.states[i], result.commands[i] = run.record.states, run.record.commands
            result.samples[i] = run.samples
    return result


def _by_messages(
    scenario: Scenario, design: Design, conditions: Conditions, result: ManyRuns, i: int
) -> int:
    messages = run_by_messages(scenario, conditions=conditions, design=design).messages
    states = [parse_state(message).values for message in messages[STATE]]
    commands = [parse_command(message).values for message in messages[COMMAND]]
    result.states[i] = states
    lost = conditions.lost
    received = slice(None) if lost is None else ~lost
    result.commands[i, received] = commands
    return len(states)
