"""Message class of `event_camera_msgs/EventPacket`, also where that package is not installed.

With ROS from wheels no package of messages can be built. Bytes that are sent and received
serialized need no more of a class than DDS needs: a name, the types of the
fields, and functions that are never called. So the type support of a message that is installed is
copied with another description. Its structures are those of `message_type_support_struct.h`
(rosidl_runtime_c), `message_introspection.h` (rosidl_typesupport_introspection_c) and
`message_type_support.h` (rosidl_typesupport_fastrtps_cpp); what they hold is checked first.
"""

from __future__ import annotations

import ctypes
import importlib
from functools import cache
from typing import Any

from dvs_common.errors import ParameterError

_NAMESPACE, _NAME = b'event_camera_msgs::msg', b'EventPacket'
# REP 2011 hash of the message, by which tools tell versions of it apart.
_HASH = bytes.fromhex('d6fa176260b1f37e5a40845305315e150a0f18191241eb64f407442aa29844aa')
_FAST_RTPS = b'rosidl_typesupport_fastrtps_c'
_INTROSPECTION = b'rosidl_typesupport_introspection_c'
_BOOLEAN, _UINT8, _UINT32, _UINT64, _STRING, _MESSAGE = 6, 8, 12, 14, 16, 18
_FIELDS = (
    (b'header', _MESSAGE),
    (b'height', _UINT32),
    (b'width', _UINT32),
    (b'seq', _UINT64),
    (b'time_base', _UINT64),
    (b'encoding', _STRING),
    (b'is_bigendian', _BOOLEAN),
    (b'events', _UINT8),
)


class _TypeSupport(ctypes.Structure):
    _fields_ = (
        ('identifier', ctypes.c_char_p),
        ('data', ctypes.c_void_p),
        ('find', ctypes.c_void_p),
        ('get_hash', ctypes.c_void_p),
        ('get_description', ctypes.c_void_p),
        ('get_sources', ctypes.c_void_p),
    )


class _Callbacks(ctypes.Structure):
    """How Fast DDS names and serializes a message."""

    _fields_ = (
        ('namespace', ctypes.c_char_p),
        ('name', ctypes.c_char_p),
        ('functions', ctypes.c_void_p * 5),
    )


class _Member(ctypes.Structure):
    """One field of a message."""

    _fields_ = (
        ('name', ctypes.c_char_p),
        ('kind', ctypes.c_uint8),
        ('string_bound', ctypes.c_size_t),
        ('message', ctypes.c_void_p),
        ('is_key', ctypes.c_bool),
        ('is_array', ctypes.c_bool),
        ('array_size', ctypes.c_size_t),
        ('is_bounded', ctypes.c_bool),
        ('offset', ctypes.c_uint32),
        ('default', ctypes.c_void_p),
        ('functions', ctypes.c_void_p * 6),
    )


class _Members(ctypes.Structure):
    """The fields of a message."""

    _fields_ = (
        ('namespace', ctypes.c_char_p),
        ('name', ctypes.c_char_p),
        ('count', ctypes.c_uint32),
        ('size', ctypes.c_size_t),
        ('has_key', ctypes.c_bool),
        ('members', ctypes.POINTER(_Member)),
        ('functions', ctypes.c_void_p * 2),
    )


class _Hash(ctypes.Structure):
    _fields_ = (('version', ctypes.c_uint8), ('value', ctypes.c_uint8 * 32))


_Find = ctypes.CFUNCTYPE(ctypes.c_void_p, ctypes.c_void_p, ctypes.c_char_p)
_GetHash = ctypes.CFUNCTYPE(ctypes.c_void_p, ctypes.c_void_p)
# What the middleware points to is kept as long as the process runs.
_kept: list[Any] = []


@cache
def event_packet_type() -> type:
    """Class to publish and to subscribe serialized EventPackets with.

    Raises
    ------
    ParameterError
        If the package is not installed, and ROS is another than the one that is known here.
    """
    try:
        found: type = importlib.import_module('event_camera_msgs.msg').EventPacket
    except ImportError:
        return _serialized_only()
    return found


def _serialized_only() -> type:
    # Only here ROS is needed.
    messages = importlib.import_module('std_msgs.msg')
    kind: Any = type(messages.String)
    fast, described = (
        _support_of(messages.String, identifier) for identifier in (_FAST_RTPS, _INTROSPECTION)
    )
    header = _support_of(messages.Header, _INTROSPECTION)
    callbacks = _Callbacks.from_address(fast.data)
    members = _Members.from_address(described.data)
    if (
        callbacks.name != b'String'
        or callbacks.namespace != b'std_msgs::msg'
        or (members.name, members.count) != (b'String', 1)
        or (members.members[0].name, members.members[0].kind) != (b'data', _STRING)
        or _Members.from_address(header.data).name != b'Header'
    ):
        raise _unknown_ros()
    own = _Callbacks.from_buffer_copy(callbacks)
    own.namespace, own.name = _NAMESPACE, _NAME
    fields = (_Member * len(_FIELDS))(*(_Member(name=name, kind=kind) for name, kind in _FIELDS))
    fields[0].message = ctypes.addressof(header)
    fields[-1].is_array = True
    description = _Members.from_buffer_copy(members)
    description.namespace, description.name = _NAMESPACE.replace(b'::', b'__'), _NAME
    description.count, description.members = len(fields), fields
    supports = {
        _FAST_RTPS: _copy(fast, own),
        _INTROSPECTION: _copy(described, description),
    }
    find = _Find(
        lambda _, identifier: (
            ctypes.addressof(supports[identifier]) if identifier in supports else 0
        )
    )
    for support in supports.values():
        support.find = ctypes.cast(find, ctypes.c_void_p).value
    capsule = ctypes.pythonapi.PyCapsule_New
    capsule.restype = ctypes.py_object
    capsule.argtypes = (ctypes.c_void_p, ctypes.c_char_p, ctypes.c_void_p)
    pointer = capsule(ctypes.addressof(supports[_FAST_RTPS]), None, None)
    metaclass = type('Metaclass_EventPacket', (kind,), {'_TYPE_SUPPORT': pointer})
    made: type = metaclass('EventPacket', (), {})
    _kept.append((own, fields, description, header, supports, find))
    return made


def _support_of(message: Any, identifier: bytes) -> _TypeSupport:
    """Type support of an installed message in one of its forms."""
    kind = type(message)
    kind.__import_type_support__()
    pointer = ctypes.pythonapi.PyCapsule_GetPointer
    pointer.restype, pointer.argtypes = ctypes.c_void_p, (ctypes.py_object, ctypes.c_char_p)
    general = _TypeSupport.from_address(pointer(kind._TYPE_SUPPORT, None))
    address = _Find(general.find)(ctypes.addressof(general), identifier)
    found = _TypeSupport.from_address(address) if address else None
    if found is None or found.identifier != identifier:
        raise _unknown_ros()
    return found


def _copy(support: _TypeSupport, data: ctypes.Structure) -> _TypeSupport:
    """Copy of a type support that describes our message."""
    hashed = _Hash(1, (ctypes.c_uint8 * 32)(*_HASH))
    get_hash = _GetHash(lambda _: ctypes.addressof(hashed))
    copy = _TypeSupport.from_buffer_copy(support)
    copy.data = ctypes.addressof(data)
    copy.get_hash = ctypes.cast(get_hash, ctypes.c_void_p).value
    _kept.append(get_hash)
    return copy


def _unknown_ros() -> ParameterError:
    rule = 'is not installed (Ubuntu: ros-jazzy-event-camera-msgs), and this ROS is no Jazzy'
    return ParameterError('package', 'event_camera_msgs', rule)
