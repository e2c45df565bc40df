"""What a controller reported of its certificate is read back from /diagnostics."""

import math

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.serialization import serialize_message

from dvs_closed_loop.bags.reported_budgets import reported_budgets
from dvs_closed_loop.dashboard.live_view import LiveView
from dvs_common.scenario.scenario import Scenario
from dvs_common.wire import topics
from dvs_hinf_controller.analysis.budget import Budget

BUDGET = Budget(
    threshold=0.15, ignorance=0.01, delta_certified=0.1, unknown_pixels=3, masked_pixels=(1, 7)
)


def message(budget=BUDGET, name='hinf_controller', **others):
    figures = {**budget.figures, **others}
    values = [KeyValue(key=key, value=str(value)) for key, value in figures.items()]
    status = [DiagnosticStatus(name='plant_sim'), DiagnosticStatus(name=name, values=values)]
    return bytes(serialize_message(DiagnosticArray(status=status)))


def test_a_budget_is_read_back():
    (found,) = reported_budgets([message()])

    assert (found.used, found.unknown_pixels) == (BUDGET.used, 3)
    assert found.masked_pixels == (1, 7)
    assert math.isclose(found.delta_certified, 0.1)
    assert str(found) == 'not certified: 3 pixels unknown'


def test_an_unlimited_budget_is_read_back():
    free = Budget(threshold=0.15, ignorance=0.01, delta_certified=math.inf)

    (found,) = reported_budgets([message(free)])

    assert found.allowed == math.inf
    assert found.is_certified


def test_only_the_controller_of_the_loop_counts():
    messages = [message(name='left/hinf_controller'), message(name='right/hinf_controller')]

    assert len(reported_budgets(messages, '/left')) == 1
    assert reported_budgets(messages) == []


def test_what_can_not_be_read_is_passed_over():
    assert reported_budgets([message()[:40], b'', message(**{'max w': 'much'})]) == []


def test_the_live_page_has_the_newest_certificate():
    view = LiveView('left')
    view.receive(topics.DIAGNOSTICS, message(name='left/hinf_controller'))
    certified = Budget(threshold=0.05, ignorance=0.01, delta_certified=0.1)
    frame = view.frame(Scenario.from_values({}), 1.0)
    view.receive(topics.DIAGNOSTICS, message(certified, name='left/hinf_controller'))
    after = view.frame(Scenario.from_values({}), 2.0)

    assert (frame['certified'], after['certified']) == (False, True)
    assert frame['certificate'] == 'not certified: 3 pixels unknown'
    assert after['certificate'].startswith('certified now: h ln b + max w = 0.06 <=')
