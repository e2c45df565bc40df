"""How soon a lost message is sent again: writers ask their readers often what they miss.

Fast DDS asks every 3 s unless a profile says otherwise: a lost packet of events is missing for so
long, and a node that ends waits for the answer before it goes.
"""

from __future__ import annotations

import os
from pathlib import Path

PROFILES = 'FASTRTPS_DEFAULT_PROFILES_FILE'
# Fast DDS reads it besides.
_PROFILES_HERE = 'DEFAULT_FASTRTPS_PROFILES.xml'
_ASKS_OFTEN = str(Path(__file__).with_name('asks_often.xml'))


def ask_readers_often() -> None:
    """Let writers of this process ask ten times a second, unless the user has profiles."""
    if is_fast_dds_ours() and not Path(_PROFILES_HERE).exists():
        os.environ[PROFILES] = _ASKS_OFTEN


def is_fast_dds_ours() -> bool:
    """Whether the middleware is Fast DDS and the user has named no profiles for it."""
    middleware = os.environ.get('RMW_IMPLEMENTATION', 'rmw_fastrtps')
    # A process that started this one may have named ours.
    named = os.environ.get(PROFILES, _ASKS_OFTEN)
    return middleware.startswith('rmw_fastrtps') and named == _ASKS_OFTEN
