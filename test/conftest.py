"""Every test talks in a ROS domain of its own."""

import itertools
import os
from collections.abc import Callable, Iterator

import pytest

os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'
_DOMAINS = itertools.count(os.getpid() * 13)


@pytest.fixture(scope='session')
def new_domain() -> Callable[[], int]:
    # Domains above 101 meet the ephemeral ports of Linux.
    return lambda: 10 + next(_DOMAINS) % 91


@pytest.fixture
def domain(new_domain: Callable[[], int]) -> int:
    return new_domain()


@pytest.fixture
def processes() -> Iterator[list]:
    """Processes put in this list are gone after the test, whatever happened."""
    started: list = []
    yield started
    for process in started:
        if process.poll() is None:
            process.kill()
        process.communicate()
