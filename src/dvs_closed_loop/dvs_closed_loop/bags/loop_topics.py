"""Which topics of a bag are those of one loop: by name and type, as given, or by their content."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

from dvs_closed_loop.bags.former_estimates import FORMER_TYPE
from dvs_closed_loop.bags.streams import STREAMS, Stream, base_name
from dvs_common.errors import ParameterError
from dvs_common.wire import topics
from dvs_common.wire.cdr import MessageError
from dvs_common.wire.events import parse_events
from dvs_common.wire.keyframe import parse_keyframe
from dvs_common.wire.messages import image_head, parse_command, parse_state

FirstMessage = Callable[[str], bytes | None]

# What the topic `threshold` of the contract's first version carries.
_THRESHOLD_NAMES = ('event_threshold',)


def given_topics(pairs: Sequence[str]) -> dict[str, str]:
    """Topics of a bag by topic of the wire contract.

    Parameters
    ----------
    pairs
        ``TOPIC:=NAME``, as in ``events:=/dvs/events``.

    Raises
    ------
    ParameterError
        If a pair has another form or its topic is not in the wire contract.
    """
    given = {}
    for pair in pairs:
        topic, assigned, name = pair.partition(':=')
        if not (assigned and name):
            raise ParameterError('topic', pair, 'must be TOPIC:=NAME, as in events:=/dvs/events')
        if topic not in STREAMS:
            raise ParameterError('topic', topic, f'must be among {", ".join(STREAMS)}')
        given[topic] = '/' + name.lstrip('/')
    return given


def choose_topics(
    found: Mapping[str, str],
    *,
    namespace: str | None,
    given: Mapping[str, str],
    first_message: FirstMessage,
) -> dict[str, str]:
    """Full name of every topic of one loop.

    What was given counts first, then what is called as in the wire contract, in whatever
    namespace; of the rest, what can only be one stream by its type and its first message.

    Parameters
    ----------
    found
        Message type of every topic in the bag.
    namespace
        Namespace of the loop; None for a bag of one loop.
    given
        Full names by topic of the contract.
    first_message
        First message of a topic of the bag, or None.

    Raises
    ------
    ParameterError
        If a given topic is not there or of another type, or a topic could be one of several.
    """
    chosen = {topic: _checked(topic, name, found) for topic, name in given.items()}
    named: dict[str, list[str]] = {}
    for name, kind in sorted(found.items()):
        stream = _stream_called(name, kind)
        if stream is not None and stream.topic not in chosen and name not in chosen.values():
            named.setdefault(stream.topic, []).append(name)
    if namespace is not None:
        own = '/' + namespace.strip('/')
        inside = {t: n for t, names in named.items() for n in names if _namespace(n) == own}
        if not inside and not chosen:
            raise ParameterError('from-namespace', namespace, _one_of(named))
        return {**_shared(found), **inside, **chosen}
    for topic, names in named.items():
        own_names = [name for name in names if name != topic] or names
        if len(own_names) > 1:
            raise ParameterError(
                'from-namespace', '', f'{_one_of(named)}; or name each topic, as in --topic '
                f'{topic}:={own_names[0]}'
            )  # fmt: skip
        chosen[topic] = own_names[0]
    return {**chosen, **_recognised(found, chosen, first_message)}


def _stream_called(name: str, kind: str) -> Stream | None:
    """Stream of the contract with this name and type; a loop's own clock is in its namespace."""
    base = base_name(name)
    stream = STREAMS.get(name) or STREAMS.get(base) or STREAMS.get('/' + base)
    return stream if stream is not None and kind in _types(stream.topic) else None


def _types(topic: str) -> tuple[str, ...]:
    """Types that a topic of the contract has, or had in former recordings."""
    kind = STREAMS[topic].type_name
    return (kind, FORMER_TYPE) if topic == topics.ESTIMATE else (kind,)


def _namespace(name: str) -> str:
    return '/' + name.rpartition('/')[0].strip('/')


def _shared(found: Mapping[str, str]) -> dict[str, str]:
    """Topics that all loops share."""
    return {
        name: name
        for name, kind in found.items()
        if name in STREAMS and STREAMS[name].type_name == kind
    }


def _one_of(named: Mapping[str, Sequence[str]]) -> str:
    spaces = {_namespace(name) for t, names in named.items() for name in names if t[0] != '/'}
    return (
        f'must be one of {", ".join(sorted(spaces)) or "none: no topic of the contract is there"}'
    )


def _checked(topic: str, name: str, found: Mapping[str, str]) -> str:
    if name not in found:
        raise ParameterError('topic', name, f'must be one of {", ".join(sorted(found))}')
    if found[name] not in _types(topic):
        raise ParameterError(
            'topic', name, f'is a {found[name]}, {topic} a {STREAMS[topic].type_name}'
        )
    return name


def _recognised(
    found: Mapping[str, str], chosen: Mapping[str, str], first_message: FirstMessage
) -> dict[str, str]:
    """Topics with other names that only one stream of the contract can be."""
    recognised = {}
    for topic in _IS_ONE.keys() - chosen.keys():
        matches = [
            name
            for name, kind in sorted(found.items())
            if kind in _types(topic)
            and name not in chosen.values()
            and _is_one(topic, first_message(name))
        ]
        if len(matches) > 1:
            raise ParameterError(
                'topic', topic, f'must be chosen: --topic {topic}:=NAME of {", ".join(matches)}'
            )
        if matches:
            recognised[topic] = matches[0]
    return recognised


def _is_one(topic: str, message: bytes | None) -> bool:
    try:
        return message is not None and _IS_ONE[topic](message)
    except MessageError:
        return False


def _is_command(message: bytes) -> bool:
    command = parse_command(message)
    return bool(command.names) and command.names != _THRESHOLD_NAMES


_IS_ONE: dict[str, Callable[[bytes], bool]] = {
    topics.EVENTS: lambda message: parse_events(message) is not None,
    topics.LUMINOSITY: lambda message: image_head(message).format.encoding in ('64FC1', '32FC1'),
    topics.KEYFRAME: lambda message: parse_keyframe(message) is not None,
    topics.COMMAND: _is_command,
    topics.STATE: lambda message: parse_state(message).names[:1] not in ((), ('z1',)),
    topics.ESTIMATE: lambda message: parse_state(message).names[:1] == ('z1',),
}
