"""Every message of the loop but events and keyframes as CDR bytes: packed and parsed, by name."""

from __future__ import annotations

from dvs_common.wire.images import (
    ImageFormat,
    ImageFrame,
    ImageHead,
    image_head,
    luminosity_image,
    pack_image,
    parse_image,
)
from dvs_common.wire.joint_states import (
    Vector,
    estimate_names,
    pack_command,
    pack_estimate,
    pack_state,
    parse_command,
    parse_state,
)
from dvs_common.wire.numbers import pack_array, pack_clock, parse_array

__all__ = [
    'ImageFormat',
    'ImageFrame',
    'ImageHead',
    'Vector',
    'estimate_names',
    'image_head',
    'luminosity_image',
    'pack_array',
    'pack_clock',
    'pack_command',
    'pack_estimate',
    'pack_image',
    'pack_state',
    'parse_array',
    'parse_command',
    'parse_image',
    'parse_state',
]
