"""The command once more, in the message that an actuator of another maker takes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dvs_common.arrays import FloatArray
from dvs_common.errors import ParameterError
from dvs_common.wire.cdr import ENCAPSULATION
from dvs_common.wire.numbers import pack_array
from dvs_common.wire.topics import COMMAND_ARRAY, COMMAND_TWIST, COMMAND_WRENCH

_ARRAY = 'array'
_FORMS = {
    COMMAND_TWIST: ('linear', 'angular'),
    COMMAND_WRENCH: ('force', 'torque'),
}
# Both messages are six doubles.
_PLACES = {
    f'{vector}.{axis}': (topic, 3 * k + j)
    for topic, vectors in _FORMS.items()
    for k, vector in enumerate(vectors)
    for j, axis in enumerate('xyz')
}


@dataclass(frozen=True, slots=True, kw_only=True)
class CommandCopy:
    """Message that carries a command to others.

    Parameters
    ----------
    topic
        Where it is published, which determines the type as well.
    places
        For Twist and Wrench, place of every input among the six numbers; empty for an array.
    """

    topic: str
    places: tuple[int, ...] = ()

    def pack(self, values: FloatArray) -> bytes:
        """Serialized message; fields that no input has are zero.

        Parameters
        ----------
        values
            Input u_o, shape (m,).
        """
        if not self.places:
            return pack_array(values)
        numbers = np.zeros(6)
        numbers[list(self.places)] = values
        return ENCAPSULATION + numbers.astype('<f8').tobytes()


def command_copy(text: str, input_count: int) -> CommandCopy | None:
    """What the parameter `command_copy` asks for; None for nothing.

    Parameters
    ----------
    text
        ``array``, or the fields of the inputs, divided by commas.
    input_count
        Number of inputs m.

    Raises
    ------
    ParameterError
        If a field is unknown or named twice, the fields belong to two messages, or they are not
        as many as the inputs.
    """
    if not text.strip():
        return None
    if text.strip() == _ARRAY:
        return CommandCopy(topic=COMMAND_ARRAY)
    fields = [field.strip() for field in text.split(',')]
    if not set(fields) <= _PLACES.keys():
        rule = f'must be {_ARRAY}, or fields out of {", ".join(_PLACES)}'
        raise ParameterError('command_copy', text, rule)
    if len(fields) != input_count or len(set(fields)) != input_count:
        rule = f'must name {input_count} different field(s), one an input'
        raise ParameterError('command_copy', text, rule)
    wanted = {_PLACES[field][0] for field in fields}
    if len(wanted) > 1:
        raise ParameterError('command_copy', text, 'must be fields of one message')
    topic = wanted.pop()
    return CommandCopy(topic=topic, places=tuple(_PLACES[field][1] for field in fields))
