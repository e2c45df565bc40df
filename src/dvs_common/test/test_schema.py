"""Parameters: every rule refuses what breaks it, by name, and nothing else."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dvs_common.errors import ParameterError
from dvs_common.scenario.parameters import CAMERA, CONTROLLER, PLANT, SCHEMA
from dvs_common.scenario.schema import Interval, Kind, ParameterSpec, Schema


def spec(kind, default=0, **rules):
    return ParameterSpec(name='gain', kind=kind, default=default, description='A gain', **rules)


ACCEPTED = [
    (spec(Kind.BOOL), True, True),
    (spec(Kind.INT), 3, 3),
    (spec(Kind.INT), 3.0, 3),
    (spec(Kind.FLOAT), 3, 3.0),
    (spec(Kind.FLOAT), np.float64(0.1), 0.1),
    (spec(Kind.FLOAT), np.float32(0.5), 0.5),
    (spec(Kind.INT), np.int32(3), 3),
    (spec(Kind.TEXT), 'free', 'free'),
    (spec(Kind.TEXT, choices=('a', 'b')), 'b', 'b'),
    (spec(Kind.INTS), [1, 2.0], (1, 2)),
    (spec(Kind.FLOATS), (1, 2.5), (1.0, 2.5)),
    (spec(Kind.FLOATS), np.array([1.0, 2.0]), (1.0, 2.0)),
    (spec(Kind.FLOATS), [], ()),
    (spec(Kind.FLOAT, interval=Interval(low=0, high=1)), 0, 0.0),
    (spec(Kind.FLOAT, interval=Interval(low=0, high=1)), 1, 1.0),
]


@pytest.mark.parametrize(('parameter', 'value', 'expected'), ACCEPTED)
def test_a_fitting_value_is_taken(parameter, value, expected):
    found = parameter.validate(value)

    assert found == expected
    if isinstance(expected, tuple):
        assert [type(entry) for entry in found] == [type(entry) for entry in expected]
    else:
        assert type(found) is type(expected)


REFUSED = [
    (spec(Kind.BOOL), 1, 'must be a bool'),
    (spec(Kind.BOOL), 'true', 'must be a bool'),
    (spec(Kind.INT), 3.5, 'must be an integer'),
    (spec(Kind.INT), True, 'must be an integer'),
    (spec(Kind.INT), '3', 'must be an integer'),
    (spec(Kind.FLOAT), math.nan, 'must be a finite double'),
    (spec(Kind.FLOAT), -math.inf, 'must be a finite double'),
    pytest.param(spec(Kind.FLOAT), 10**400, 'must be a finite double', id='huge'),
    (spec(Kind.FLOAT), '0.5', 'must be a finite double'),
    (spec(Kind.FLOAT), None, 'must be a finite double'),
    (spec(Kind.FLOAT), [0.5], 'must be a finite double'),
    (spec(Kind.FLOAT), 1j, 'must be a finite double'),
    (spec(Kind.TEXT), 3, 'must be a string'),
    (spec(Kind.TEXT, choices=('a', 'b')), 'c', 'must be one of a, b'),
    (spec(Kind.INTS), [1, 2.5], 'must be an integer list'),
    (spec(Kind.INTS), '12', 'must be an integer list'),
    (spec(Kind.INTS), b'12', 'must be an integer list'),
    (spec(Kind.INTS), 3, 'must be an integer list'),
    (spec(Kind.FLOATS), {1.0: 2.0}, 'must be a double list'),
    (spec(Kind.FLOATS), [1.0, math.nan], 'must be a double list without NaN or infinity'),
    (spec(Kind.FLOATS), [[1.0]], 'must be a double list'),
    (spec(Kind.FLOATS, interval=Interval(low=0)), [1.0, -1.0], '>= 0'),
    (spec(Kind.FLOAT, interval=Interval(low=0, low_open=True)), 0.0, '> 0'),
    (spec(Kind.FLOAT, interval=Interval(low=0, high=2)), 2.1, '>= 0 and <= 2'),
    (spec(Kind.INT, interval=Interval(high=5)), 6, '<= 5'),
]


@pytest.mark.parametrize(('parameter', 'value', 'rule'), REFUSED)
def test_a_value_that_breaks_the_rule_is_refused(parameter, value, rule):
    with pytest.raises(ParameterError) as caught:
        parameter.validate(value)

    assert caught.value.name == 'gain'
    assert str(caught.value).startswith('gain = ')
    assert rule in caught.value.rule


@given(st.floats(), st.floats(-10, 10), st.floats(0, 10), st.booleans())
def test_an_interval_contains_what_its_text_describes(number, low, length, low_open):
    interval = Interval(low=low, high=low + length, low_open=low_open)

    above = number > low if low_open else number >= low
    assert (number in interval) == (above and number <= low + length)


def test_nan_is_in_no_interval():
    assert math.nan not in Interval()


@pytest.mark.parametrize(
    ('name', 'hint'),
    [
        ('event_treshold', 'is not a parameter of this suite; did you mean event_threshold?'),
        ('setpoint', 'is not a parameter of this suite; did you mean set_point?'),
        ('zzz', 'is not a parameter of this suite'),
    ],
)
def test_an_unknown_name_is_refused_with_the_nearest_known_one(name, hint):
    with pytest.raises(ParameterError) as caught:
        SCHEMA.validate({name: 1.0})
    assert caught.value.rule == hint


def test_what_is_not_given_has_its_default():
    values = SCHEMA.validate({'event_threshold': 0.3})

    assert list(values) == list(SCHEMA)
    assert values.pop('event_threshold') == 0.3
    assert values == {name: SCHEMA[name].default for name in values}


@pytest.mark.parametrize('name', SCHEMA)
def test_a_default_obeys_its_own_rule(name):
    found = SCHEMA[name].validate(SCHEMA[name].default)

    assert found == SCHEMA[name].default
    assert type(found) is type(SCHEMA[name].default)


def test_a_name_cannot_be_listed_twice():
    with pytest.raises(ValueError, match='gain is listed twice'):
        Schema([spec(Kind.INT), spec(Kind.FLOAT)])


def test_a_node_has_the_parameters_that_name_it():
    nodes = {PLANT, CAMERA, CONTROLLER}
    for node in nodes:
        own = SCHEMA.of_node(node)
        assert {s.name for s in own} == {n for n in SCHEMA if node in SCHEMA[n].nodes}
    assert {s.name for s in SCHEMA.of_node(PLANT)} >= {'state_matrix', 'mode', 'autostart'}
    assert all(spec.nodes <= nodes for spec in SCHEMA.values())


def test_a_long_value_is_shortened_in_the_message():
    with pytest.raises(ParameterError) as caught:
        spec(Kind.FLOAT).validate('x' * 1000)
    assert len(str(caught.value)) < 200


@pytest.mark.parametrize('kind', [Kind.FLOAT, Kind.INT])
def test_a_number_that_is_written_as_text_is_shown_in_quotes(kind):
    with pytest.raises(ParameterError, match=r"= '1e-3': must be a"):
        spec(kind).validate('1e-3')
