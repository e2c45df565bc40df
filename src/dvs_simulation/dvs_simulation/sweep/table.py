"""One CSV file that a sweep grows, task by task, and from which a killed sweep goes on."""

from __future__ import annotations

import csv
import io
import json
import os
from pathlib import Path
from typing import Any

from dvs_common.errors import ParameterError
from dvs_common.output_folder import output_folder
from dvs_common.writing import naming_file, write_text
from dvs_simulation.sweep.study import Row, Study, Task


class ResultTable:
    """Rows of finished tasks.

    The first line is a comment with the study's name and options. A task's rows are appended at
    once; what a killed sweep left half-written is dropped when the table is opened again, so that
    nothing is lost that was finished and nothing is counted twice.

    Parameters
    ----------
    path
        CSV file; made if it is not there.
    study
        The study that fills it.

    Raises
    ------
    ParameterError
        If the file belongs to another study or to other options, or its folder can't be made.
    """

    def __init__(self, path: Path, study: Study) -> None:
        self._path = path
        self._study = study
        self._header = json.dumps({'study': study.name, **study.options}, sort_keys=True)
        self._columns = ('task', 'row', *study.columns)
        self.finished: set[str] = set()
        output_folder(path.parent)
        kept = self._complete_rows() if path.exists() else []
        self._rewrite(kept)

    def append(self, task: Task, rows: list[Row]) -> None:
        """Add a finished task and make it durable.

        Parameters
        ----------
        task
            The task.
        rows
            All of its rows.
        """
        text = self._format(
            [{'task': task.key, 'row': i, **row} for i, row in enumerate(rows)], header=False
        )
        with (
            naming_file(self._path),
            self._path.open('a', encoding='utf-8', newline='') as file,
        ):
            file.write(text)
            file.flush()
            os.fsync(file.fileno())
        self.finished.add(task.key)

    def rows(self) -> list[dict[str, str]]:
        """All rows, values as text, ordered as the study's tasks."""
        order = {task.key: i for i, task in enumerate(self._study.tasks)}
        found = read_rows(self._path)
        return sorted(found, key=lambda row: (order[row['task']], int(row['row'])))

    def _complete_rows(self) -> list[dict[str, str]]:
        with self._path.open(encoding='utf-8') as file:
            first = file.readline()
        if not first:
            return []
        if first.removeprefix('# ').rstrip('\n') != self._header:
            raise ParameterError(
                'output',
                self._path,
                'holds another sweep (other study or options): choose another file or remove it',
            )
        wanted = {task.key: task.rows for task in self._study.tasks}
        by_task: dict[str, list[dict[str, str]]] = {}
        for row in read_rows(self._path):
            by_task.setdefault(row['task'], []).append(row)
        kept = []
        for key, rows in by_task.items():
            if len(rows) == wanted.get(key):
                self.finished.add(key)
                kept += rows
        return kept

    def _rewrite(self, rows: list[dict[str, str]]) -> None:
        write_text(self._path, f'# {self._header}\n{self._format(rows, header=True)}')

    def _format(self, rows: list[Any], *, header: bool) -> str:
        text = io.StringIO()
        writer = csv.DictWriter(text, self._columns, lineterminator='\n')
        if header:
            writer.writeheader()
        writer.writerows(rows)
        return text.getvalue()


def read_rows(path: Path) -> list[dict[str, str]]:
    """Whole rows of a table; a last line without its end is left out.

    Parameters
    ----------
    path
        CSV file of a sweep.
    """
    text = path.read_text(encoding='utf-8')
    whole = text[: text.rfind('\n') + 1].splitlines()[1:]
    reader = csv.DictReader(whole)
    return [row for row in reader if None not in row and None not in row.values()]
