"""How soon a lost message is sent again and a node that has just started is met.

Fast DDS asks every 3 s what readers miss: a lost packet of events is missing for so long, and a
node that ends waits for the answer before it goes. As often it announces a participant, once the
first half second is over: one that starts can miss the answer to its own first announcement, in
one start of ten, and then knows nothing of those that run until they announce themselves again.
"""

from __future__ import annotations

import os
from pathlib import Path

PROFILES = 'FASTRTPS_DEFAULT_PROFILES_FILE'
# Fast DDS reads it besides.
_PROFILES_HERE = 'DEFAULT_FASTRTPS_PROFILES.xml'
_SHORT_PERIODS = str(Path(__file__).with_name('short_periods.xml'))


def shorten_periods() -> None:
    """Let this process ask and announce several times a second, unless the user has profiles."""
    if is_fast_dds_ours() and not Path(_PROFILES_HERE).exists():
        os.environ[PROFILES] = _SHORT_PERIODS


def is_fast_dds_ours() -> bool:
    """Whether the middleware is Fast DDS and the user has named no profiles for it."""
    middleware = os.environ.get('RMW_IMPLEMENTATION', 'rmw_fastrtps')
    # A process that started this one may have named ours.
    named = os.environ.get(PROFILES, _SHORT_PERIODS)
    return middleware.startswith('rmw_fastrtps') and named == _SHORT_PERIODS
