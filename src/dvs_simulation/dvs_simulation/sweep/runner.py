"""Run what is left of a study on Dask, row by row into its table."""

from __future__ import annotations

import time
from collections.abc import Iterator
from importlib import import_module
from itertools import islice
from pathlib import Path
from typing import Any

from tqdm import tqdm

from dvs_simulation.sweep.cluster import THIS_MACHINE, Cluster
from dvs_simulation.sweep.study import Row, Study, Task
from dvs_simulation.sweep.table import ResultTable

# Tasks handed out ahead of their results: enough to keep workers busy, few enough to stop soon.
_AHEAD = 4


def run_study(
    study: Study,
    path: Path,
    *,
    cluster: Cluster = THIS_MACHINE,
    progress: bool = True,
) -> ResultTable:
    """Run all tasks of `study` that `path` does not hold yet.

    Parameters
    ----------
    study
        The study.
    path
        Its table.
    cluster
        Where to run them.
    progress
        Whether to show a progress bar.

    Raises
    ------
    ParameterError
        If `path` belongs to another sweep, or the cluster cannot be reached.
    """
    table = ResultTable(path, study)
    left = [task for task in study.tasks if task.key not in table.finished]
    total = sum(task.rows for task in study.tasks)
    done = total - sum(task.rows for task in left)
    with tqdm(total=total, initial=done, unit='run', desc=study.name, disable=not progress) as bar:
        if left:
            with cluster.client() as client:
                began_s, workers = time.perf_counter(), _worker_count(client)
                for task, rows in _results(client, study, left):
                    table.append(task, rows)
                    bar.update(task.rows)
                print(_cost(total - done, time.perf_counter() - began_s, workers))
    return table


def _worker_count(client: Any) -> int:
    return max(1, len(client.scheduler_info(n_workers=-1)['workers']))


def _cost(runs: int, seconds: float, workers: int) -> str:
    each = 1e3 * seconds * workers / runs
    return f'{runs} runs in {seconds:.1f} s on {workers} workers: {each:.3g} ms of a worker each'


def _results(client: Any, study: Study, tasks: list[Task]) -> Iterator[tuple[Task, list[Row]]]:
    as_completed: Any = import_module('distributed').as_completed
    waiting = iter(tasks)
    owner: dict[str, Task] = {}

    def submit(task: Task) -> Any:
        future = client.submit(study.function, **task.parameters, key=f'{study.name}-{task.key}')
        owner[future.key] = task
        return future

    slots = _AHEAD * _worker_count(client)
    running = as_completed([submit(task) for task in islice(waiting, slots)])
    for future in running:
        rows = future.result()
        yield owner.pop(future.key), rows
        following = next(waiting, None)
        if following is not None:
            running.add(submit(following))
