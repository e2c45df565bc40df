"""Run a study on Dask: a cluster of this machine's cores, or a scheduler somewhere."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from importlib import import_module
from itertools import islice
from pathlib import Path
from typing import Any

from tqdm import tqdm

from dvs_common.errors import ParameterError
from dvs_simulation.sweep.study import Row, Study, Task
from dvs_simulation.sweep.table import ResultTable

# Tasks handed out ahead of their results: enough to keep workers busy, few enough to stop soon.
# A scheduler that is there answers within this time.
_ANSWER_S = 10
_AHEAD = 4


def run_study(
    study: Study,
    path: Path,
    *,
    scheduler: str | None = None,
    workers: int | None = None,
    processes: bool = True,
    progress: bool = True,
) -> ResultTable:
    """Run all tasks of `study` that `path` does not hold yet.

    Parameters
    ----------
    study
        The study.
    path
        Its table.
    scheduler
        Address of a Dask scheduler, as ``tcp://host:8786``; default a cluster on this machine.
    workers
        Workers of the local cluster; default one a core.
    processes
        Whether local workers are processes; threads serve small sweeps and tests.
    progress
        Whether to show a progress bar.

    Raises
    ------
    ParameterError
        If `path` belongs to another sweep.
    """
    table = ResultTable(path, study)
    left = [task for task in study.tasks if task.key not in table.finished]
    total = sum(task.rows for task in study.tasks)
    done = total - sum(task.rows for task in left)
    with tqdm(total=total, initial=done, unit='run', desc=study.name, disable=not progress) as bar:
        if left:
            with _client(scheduler, workers, processes) as client:
                for task, rows in _results(client, study, left):
                    table.append(task, rows)
                    bar.update(task.rows)
    return table


@contextmanager
def _client(scheduler: str | None, workers: int | None, processes: bool) -> Iterator[Any]:
    distributed: Any = import_module('distributed')

    if scheduler is not None:
        with _remote_client(distributed, scheduler) as client:
            yield client
        return
    cluster = distributed.LocalCluster(
        n_workers=workers or os.cpu_count(),
        threads_per_worker=1,
        processes=processes,
        dashboard_address=':0',  # any free port: a taken one would be told in a warning
        silence_logs=50,
    )
    with cluster, distributed.Client(cluster) as client:
        yield client


def _remote_client(distributed: Any, scheduler: str) -> Any:
    try:
        return distributed.Client(scheduler, timeout=_ANSWER_S)
    except (OSError, ValueError) as error:
        raise ParameterError('scheduler', scheduler, f'does not answer: {error}') from None


def _results(client: Any, study: Study, tasks: list[Task]) -> Iterator[tuple[Task, list[Row]]]:
    as_completed: Any = import_module('distributed').as_completed
    waiting = iter(tasks)
    owner: dict[str, Task] = {}

    def submit(task: Task) -> Any:
        future = client.submit(study.function, **task.parameters, key=f'{study.name}-{task.key}')
        owner[future.key] = task
        return future

    slots = _AHEAD * max(1, len(client.scheduler_info(n_workers=-1)['workers']))
    running = as_completed([submit(task) for task in islice(waiting, slots)])
    for future in running:
        rows = future.result()
        yield owner.pop(future.key), rows
        following = next(waiting, None)
        if following is not None:
            running.add(submit(following))
