import csv
import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path
from urllib.error import HTTPError
from urllib.request import urlopen

import numpy as np
import pytest

from dvs_common.errors import ParameterError
from dvs_common.writing import WriteError
from dvs_simulation.cli import main
from dvs_simulation.sweep.certificate import certificate_study, summarize_certificate
from dvs_simulation.sweep.cluster import Cluster, TlsFiles, interrupts_for_us_alone
from dvs_simulation.sweep.pixels import pixels_study, run_pixels_task
from dvs_simulation.sweep.runner import run_study
from dvs_simulation.sweep.study import Study, Task
from dvs_simulation.sweep.sweep_figures import save_study_figure
from dvs_simulation.sweep.table import ResultTable, read_rows
from dvs_simulation.sweep.threshold import critical_thresholds, run_threshold_task

pytestmark = pytest.mark.processes


def square(*, number: int) -> list[dict[str, float]]:
    return [{'value': number**2 + i} for i in range(2)]


CALLS: list[int] = []


def counting(*, number: int) -> list[dict[str, float]]:
    CALLS.append(number)
    return square(number=number)


def squares(count: int, **options: object) -> Study:
    tasks = [Task(key=f't{n}', parameters={'number': n}, rows=2) for n in range(count)]
    return Study(name='squares', columns=('value',), function=square, tasks=tasks, options=options)


def run_here(study, path, scheduler=None):
    return run_study(study, path, cluster=Cluster(processes=False, workers=1), progress=False)


def test_every_task_is_run_once_whatever_the_number_of_slots(tmp_path):
    for count in (1, 3, 4, 5, 9):
        table = run_here(squares(count), tmp_path / f'{count}.csv')
        values = [int(row['value']) for row in table.rows()]
        assert values == [n**2 + i for n in range(count) for i in range(2)]


def test_a_killed_sweep_goes_on_and_counts_nothing_twice(tmp_path):
    path = tmp_path / 'table.csv'
    study = squares(6)
    table = ResultTable(path, study)
    for task in study.tasks[:3]:
        table.append(task, square(**task.parameters))
    whole = path.read_text()
    path.write_text(whole + 't3,0,9\nt4,0,16\nt4,1,1')  # half a task, and a torn line

    CALLS.clear()
    again = Study(
        name='squares', columns=('value',), function=counting, tasks=study.tasks, options={}
    )
    rows = run_here(again, path).rows()
    assert sorted(CALLS) == [3, 4, 5]
    assert [(row['task'], row['row']) for row in rows] == [
        (f't{n}', str(i)) for n in range(6) for i in range(2)
    ]
    assert not (tmp_path / 'table.csv.part').exists()


def test_a_finished_sweep_starts_no_cluster(tmp_path):
    path = tmp_path / 'table.csv'
    run_here(squares(2), path)
    run_study(squares(2), path, cluster=Cluster(scheduler='tcp://127.0.0.1:1'), progress=False)


def test_another_sweep_is_not_continued(tmp_path):
    path = tmp_path / 'table.csv'
    run_here(squares(2, seed=0), path)
    with pytest.raises(ParameterError, match='another sweep'):
        ResultTable(path, squares(2, seed=1))


def test_the_table_is_plain_csv_below_its_comment(tmp_path):
    path = tmp_path / 'table.csv'
    run_here(squares(2), path)
    lines = path.read_text().splitlines()
    assert lines[0].startswith('# {')
    assert next(csv.reader(lines[1:])) == ['task', 'row', 'value']
    assert len(read_rows(path)) == 4


def test_certificate_is_not_violated_on_a_few_random_plants(tmp_path):
    rows = run_here(certificate_study(plants=3, runs=12, seed=5), tmp_path / 'c.csv').rows()
    summary = summarize_certificate(rows)
    assert summary.plants == 3
    assert summary.runs >= 30
    assert summary.violations == 0
    assert 0.05 < summary.tightest <= 1
    save_study_figure('certificate', rows, tmp_path / 'c.png')
    assert (tmp_path / 'c.png').stat().st_size > 10_000


def test_a_violation_would_be_counted():
    row = {'status': 'completed', 'seed': '1', 'ratio': '1.01'}
    assert summarize_certificate([row, {**row, 'ratio': '0.5'}]).violations == 1
    assert summarize_certificate([{**row, 'ratio': 'nan'}]).violations == 1


def test_threshold_study_finds_the_order_of_the_thresholds(tmp_path):
    rows = run_threshold_task(
        method='structured', pixels=1, thresholds=[0.05, 0.12, 0.3, 0.4], runs=3, seed=0
    )
    text = [{key: str(value) for key, value in row.items()} for row in rows]
    (line,) = critical_thresholds(text)
    assert line.h_certified < line.h_star < line.simulated <= 0.4
    save_study_figure('threshold', text, tmp_path / 't.png')


def test_pixels_study_gives_a_row_for_every_run(tmp_path):
    rows = run_pixels_task(count=25, threshold=0.14, runs=3, seed=0)
    assert [row['status'] for row in rows] == ['completed'] * 3
    assert all(0 < row['mean'] < row['limsup'] < 0.05 for row in rows)
    save_study_figure(
        'pixels', [{k: str(v) for k, v in row.items()} for row in rows], tmp_path / 'p.png'
    )
    assert len({task.key for task in pixels_study().tasks}) == 7
    assert np.isfinite([row['h_star'] for row in rows]).all()


@pytest.mark.parametrize(
    ('option', 'value', 'rule'),
    [
        ('runs', '0', '>= 1'),
        ('plants', '0', '>= 1'),
        ('workers', '-2', '>= 1'),
        ('seed', '-1', '>= 0'),
    ],
)
def test_a_number_that_makes_no_sense_is_refused(option, value, rule, tmp_path, capsys):
    output = tmp_path / 'out.csv'

    assert main(['sweep', '--study', 'pixels', '--output', str(output), f'--{option}', value]) == 2

    assert f'{option} = {value}: must be {rule}' in capsys.readouterr().err
    assert not output.exists()


@pytest.mark.parametrize('address', ['tcp://127.0.0.1:9', 'nowhere'])
def test_a_scheduler_that_does_not_answer_is_named(address, tmp_path, capsys, monkeypatch):
    monkeypatch.setattr('dvs_simulation.sweep.cluster._ANSWER_S', 1)
    arguments = ['sweep', '--study', 'pixels', '--output', str(tmp_path / 'out.csv')]

    assert main([*arguments, '--scheduler', address, '--no-progress']) == 2

    assert f'scheduler = {address}: does not answer' in capsys.readouterr().err


def listening_addresses(pids):
    """Local addresses (hexadecimal) of the TCP sockets that the processes listen on."""
    inodes = {
        str(link.readlink())
        for pid in pids
        for link in Path(f'/proc/{pid}/fd').iterdir()
        if link.is_symlink()
    }
    rows = [
        line.split()
        for table in ('tcp', 'tcp6')
        for line in Path(f'/proc/net/{table}').read_text().splitlines()[1:]
    ]
    return {
        row[1].split(':')[0] for row in rows if row[3] == '0A' and f'socket:[{row[9]}]' in inodes
    }


def test_a_local_cluster_listens_on_loopback_alone_and_has_no_page():
    with Cluster(workers=1).client() as client:
        children = client.run(os.getpid).values()
        addresses = listening_addresses({os.getpid(), *children})
        port = client.scheduler_info()['services']['dashboard']
        with pytest.raises(HTTPError, match='404'):
            urlopen(f'http://127.0.0.1:{port}/status')

    assert addresses == {'0100007F'}


def test_a_scheduler_with_tls_needs_its_files(tmp_path):
    files = TlsFiles(authority=tmp_path / 'ca', certificate=tmp_path / 'c', key=tmp_path / 'k')

    with pytest.raises(ParameterError, match='tls'), Cluster(scheduler='tls://h:1').client():
        pass
    cluster = Cluster(scheduler='tls://h:1', tls=files)
    with pytest.raises(ParameterError, match='is not a file'), cluster.client():
        pass


def test_ctrl_c_keeps_the_rows_and_prints_one_line(tmp_path):
    path = tmp_path / 'sweep.csv'
    command = ['sweep', '--study', 'certificate', '--plants', '200', '--runs', '4']
    command += ['--workers', '2', '--no-progress', '--output', str(path)]
    code = f'import sys; from dvs_simulation.cli import main; sys.exit(main({command!r}))'
    process = subprocess.Popen(
        [sys.executable, '-c', code],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        start_new_session=True,
    )
    while process.poll() is None and not (path.exists() and read_rows(path)):
        time.sleep(0.05)
    os.killpg(process.pid, signal.SIGINT)
    output, _ = process.communicate(timeout=60)

    assert process.returncode == 0
    assert output.startswith('interrupted: ') and output.count('\n') == 1
    assert len(read_rows(path)) >= 4


def test_a_full_disk_names_the_table(tmp_path):
    study = squares(2)
    table = ResultTable(tmp_path / 'table.csv', study)
    (tmp_path / 'table.csv').unlink()
    (tmp_path / 'table.csv').symlink_to('/dev/full')

    with pytest.raises(WriteError, match=r'table\.csv: cannot be written: No space left'):
        table.append(study.tasks[0], square(number=0))


def test_an_interrupt_while_workers_start_is_handled_when_they_have_started():
    """Also where a thread that was there before takes the signal, as those of BLAS do."""
    end = threading.Event()
    older = threading.Thread(target=end.wait)
    older.start()
    started = False
    try:
        with pytest.raises(KeyboardInterrupt), interrupts_for_us_alone():
            os.kill(os.getpid(), signal.SIGINT)
            signal.pthread_kill(older.ident, signal.SIGINT)
            for _ in range(1000):
                time.sleep(1e-4)
            started = True
    finally:
        end.set()
        older.join()

    assert started
