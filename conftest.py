"""What all tests share: examples that are the same at every run, and ROS domains of their own."""

import contextlib
import fcntl
import itertools
import os
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from hypothesis import settings

# No test measures time.
settings.register_profile('suite', deadline=None, max_examples=50, derandomize=True)
settings.load_profile('suite')

os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'
# Domains above 101 meet the ephemeral ports of Linux.
_DOMAINS = 101
_TURNS = itertools.count(os.getpid() * 13)


@pytest.fixture(scope='module')
def new_domain() -> Iterator[Callable[[], int]]:
    """Gives out ROS domains in which nobody else on this machine tests."""
    with contextlib.ExitStack() as held:
        yield lambda: _free_domain(held)


@pytest.fixture
def domain(new_domain: Callable[[], int]) -> int:
    """A ROS domain for this test alone."""
    return new_domain()


def _free_domain(held: contextlib.ExitStack) -> int:
    """Domain whose lock file this process holds; the system frees it whatever happens."""
    for turn in itertools.islice(_TURNS, _DOMAINS):
        domain = 1 + turn % _DOMAINS
        path = Path(tempfile.gettempdir()) / f'dvs_test_domain_{domain}.lock'
        lock = held.enter_context(path.open('a'))
        with contextlib.suppress(BlockingIOError):
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            return domain
    raise RuntimeError(f'all {_DOMAINS} ROS domains are in use')
