"""Processes that end with their test."""

from collections.abc import Iterator

import pytest


@pytest.fixture
def processes() -> Iterator[list]:
    """Processes put in this list are gone after the test, whatever happened."""
    started: list = []
    yield started
    for process in started:
        process.kill()
        process.wait()
        if process.stdout:
            process.stdout.close()
