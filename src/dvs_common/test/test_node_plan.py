"""How a node's command line and namespace come about."""

from pathlib import Path

import pytest

from dvs_common.errors import ParameterError
from dvs_common.node.node_plan import NodePlan, checked_namespace


@pytest.mark.parametrize(
    ('given', 'wanted'),
    [('', ''), ('/', ''), ('left', '/left'), ('/left', '/left'), ('cell_1/left', '/cell_1/left')],
)
def test_a_namespace_becomes_absolute(given, wanted):
    assert checked_namespace(given) == wanted


@pytest.mark.parametrize('given', ['1x', 'a//b', 'a/', 'a b', '~a', 'a-b', '/a/2'])
def test_what_is_no_name_is_refused(given):
    with pytest.raises(ParameterError, match=r'^namespace = '):
        checked_namespace(given)


def test_without_anything_the_command_line_has_no_rules():
    assert NodePlan(package='p', executable='e').arguments == ['--ros-args']


def test_a_namespace_takes_the_clock_along():
    plan = NodePlan(
        package='p',
        executable='e',
        parameter_file=Path('a.yaml'),
        parameters={'mode': 'realtime', 'autostart': False, 'duration': 1.5},
        namespace='/left',
        options=('--plant-waits',),
    )
    assert plan.remappings == (('/clock', 'clock'),)
    assert plan.arguments == [
        *('--plant-waits', '--ros-args', '--params-file', 'a.yaml'),
        *('-p', 'mode:=realtime', '-p', 'autostart:=false', '-p', 'duration:=1.5'),
        *('-r', '__ns:=/left', '-r', '/clock:=clock'),
    ]
