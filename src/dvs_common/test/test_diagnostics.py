"""Diagnostics are read from their bytes as the generated class writes them."""

import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.serialization import serialize_message

from dvs_common.wire.cdr import MessageError
from dvs_common.wire.diagnostics import Status, parse_diagnostics

FIGURES = {'h ln b': '0.15', 'certificate': 'certified now: h ln b + max w = 0.1 ≤ 0.2'}


def message():
    values = [KeyValue(key=key, value=value) for key, value in FIGURES.items()]
    one = DiagnosticStatus(level=b'\x02', name='a/hinf_controller', message='lost', values=values)
    array = DiagnosticArray(status=[one, DiagnosticStatus(name='plant_sim', hardware_id='x')])
    array.header.frame_id = 'odd'
    return bytes(serialize_message(array))


def test_every_status_is_read():
    first, second = parse_diagnostics(message())

    assert first == Status(name='a/hinf_controller', level=2, message='lost', values=FIGURES)
    assert (first.node, second.node) == ('hinf_controller', 'plant_sim')
    assert (second.level, second.values) == (0, {})


def test_a_message_that_is_cut_short_anywhere_is_refused():
    whole = message()
    # What is behind the last text is padding.
    for size in range(len(whole) - 4):
        with pytest.raises(MessageError):
            parse_diagnostics(whole[:size])
