"""Event times against an independent reference in forty digits."""

import numpy as np
from closed_loop_cases import mirror_loop, paper_plant, stiff_controller
from reference_automaton import ReferenceAutomaton

from dvs_simulation.exact import automaton, modes, simulate

PRECISION_S = 1e-9


def assert_same_events(loop, *, count, step, until):
    reference = ReferenceAutomaton(loop).run(count, step, until)
    run = simulate(loop, duration=until)
    k = len(reference)
    assert k >= 10
    assert run.event_pixel[:k].tolist() == [pixel for _, pixel, _ in reference]
    assert run.event_polarity[:k].tolist() == [polarity for _, _, polarity in reference]
    errors = [abs(float(time - run.event_time[i])) for i, (time, _, _) in enumerate(reference)]
    assert max(errors) < PRECISION_S
    return max(errors)


def test_event_times_of_the_example_agree_with_forty_digits():
    assert assert_same_events(mirror_loop(3), count=30, step=1e-2, until=2.0) < 1e-12


def test_event_times_with_a_pole_at_minus_one_million():
    loop = mirror_loop(1, controller=stiff_controller(paper_plant()))
    assert assert_same_events(loop, count=12, step=4e-3, until=1.0) < 1e-11


def test_dense_blocks_give_the_events_of_split_ones(monkeypatch):
    loop = mirror_loop(3)
    expected = simulate(loop, duration=2.0).event_time
    together = modes.modal_form(automaton._system_matrix(loop), split_bound=1e-3)
    assert together.dense_blocks
    monkeypatch.setattr(automaton, 'modal_form', lambda f: together)
    np.testing.assert_allclose(simulate(loop, duration=2.0).event_time, expected, atol=1e-11)
