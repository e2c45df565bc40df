"""What a sweep consists of: tasks that give rows, the same ones for the same options."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

Row = dict[str, Any]


@dataclass(frozen=True, slots=True, kw_only=True)
class Task:
    """A piece of work for one worker; its key and parameters describe it completely.

    Parameters
    ----------
    key
        Name that is unique within the sweep.
    parameters
        Arguments of the study's function; plain values.
    rows
        Number of rows that it gives.
    """

    key: str
    parameters: dict[str, Any] = field(default_factory=dict)
    rows: int = 1


@dataclass(frozen=True, slots=True, kw_only=True)
class Study:
    """A sweep.

    Parameters
    ----------
    name
        Name of the study.
    columns
        Columns of its table, after `task` and `row`.
    function
        Called on a worker with a task's parameters; returns its rows. A function of a module, so
        that a worker elsewhere finds it.
    tasks
        All tasks.
    options
        What the tasks were made from; a table is only continued with the same options.
    """

    name: str
    columns: tuple[str, ...]
    function: Callable[..., list[Row]]
    tasks: Sequence[Task]
    options: dict[str, Any]
