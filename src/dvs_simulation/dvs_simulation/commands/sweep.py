"""Subcommand `sweep`: Monte Carlo studies on Dask."""

from __future__ import annotations

import argparse
import math
from pathlib import Path

from dvs_common.errors import ParameterError
from dvs_common.output_folder import output_file
from dvs_common.scenario.scenario import load_scenario
from dvs_hinf_controller.design.figure_words import threshold_words
from dvs_simulation.sweep import own_plant
from dvs_simulation.sweep.certificate import certificate_study, summarize_certificate
from dvs_simulation.sweep.cluster import Cluster, TlsFiles
from dvs_simulation.sweep.pixels import pixels_study
from dvs_simulation.sweep.promise import promise_study, summarize_promise
from dvs_simulation.sweep.runner import run_study
from dvs_simulation.sweep.study import Study
from dvs_simulation.sweep.sweep_figures import save_study_figure
from dvs_simulation.sweep.table import read_rows
from dvs_simulation.sweep.threshold import critical_thresholds, threshold_study

_DEFAULT_PLANTS, _DEFAULT_RUNS = (
    220,
    {'certificate': 500, 'promise': 500, 'threshold': 40, 'pixels': 200},
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Describe the arguments.

    Parameters
    ----------
    parser
        Parser of the subcommand.
    """
    parser.add_argument(
        '--study',
        required=True,
        choices=sorted(_DEFAULT_RUNS),
        help='certificate: no run below h_certified violates eps, on random plants; threshold: '
        'simulated critical h beside h* and h_certified; pixels: long-run error against r; '
        'promise: no sampled run within the promise violates eps, on random plants',
    )
    parser.add_argument(
        '--params-file',
        type=Path,
        help='scenario of your own (threshold): random and adversarial runs of its plant',
    )
    parser.add_argument(
        '--output',
        type=Path,
        default=Path('out'),
        help='folder of the results (out), or the CSV file; a killed sweep goes on there',
    )
    parser.add_argument(
        '--runs',
        type=int,
        help='runs per plant (certificate), per h (threshold) or per r (pixels)',
    )
    parser.add_argument('--plants', type=int, default=_DEFAULT_PLANTS, help='certificate, promise')
    parser.add_argument('--seed', type=int, default=0, help='seed of everything random')
    parser.add_argument('--scheduler', metavar='ADDRESS', help='Dask scheduler, tcp://host:8786')
    parser.add_argument('--workers', type=int, help='local workers (one a core)')
    parser.add_argument(
        '--dask-dashboard', type=int, metavar='PORT', help="Dask's web page on 127.0.0.1 (off)"
    )
    parser.add_argument(
        '--tls',
        type=Path,
        nargs=3,
        metavar=('CA', 'CERT', 'KEY'),
        help='PEM files for a tls:// scheduler',
    )
    parser.add_argument('--no-progress', action='store_true', help='no progress bar')


def run(options: argparse.Namespace) -> int:
    """Run the study and print its result; 1 if the certificate was violated.

    Parameters
    ----------
    options
        Parsed arguments.

    Raises
    ------
    ParameterError
        If an argument breaks its rule.
    """
    for name, least in (
        ('runs', 1),
        ('plants', 1),
        ('workers', 1),
        ('seed', 0),
        ('dask_dashboard', 1),
    ):
        value = getattr(options, name)
        if value is not None and value < least:
            raise ParameterError(name, value, f'must be >= {least}')
    study = _study(options)
    # The plant of one file is another study than that of the next.
    scenario = f'-{options.params_file.stem}' if options.params_file else ''
    path = output_file(options.output, f'{study.name}{scenario}.csv')
    try:
        table = run_study(
            study,
            path,
            cluster=_cluster(options),
            progress=not options.no_progress,
        )
    except KeyboardInterrupt:
        kept = len(read_rows(path)) if path.exists() else 0
        print(f'interrupted: {kept} runs are kept in {path}; the same command goes on from there')
        return 0
    rows = table.rows()
    figure = path.with_suffix('.png')
    save_study_figure(study.name, rows, figure)
    print(f'{len(rows)} runs in {path}, figure in {figure}')
    return _report(study, rows)


def _cluster(options: argparse.Namespace) -> Cluster:
    tls = None
    if options.tls:
        authority, certificate, key = options.tls
        tls = TlsFiles(authority=authority, certificate=certificate, key=key)
    return Cluster(
        scheduler=options.scheduler,
        workers=options.workers,
        dashboard_port=options.dask_dashboard,
        tls=tls,
    )


def _study(options: argparse.Namespace) -> Study:
    if options.params_file and options.study != 'threshold':
        rule = 'is for --study threshold; the other studies draw their own plants'
        raise ParameterError('params_file', options.params_file, rule)
    runs = options.runs or _DEFAULT_RUNS[options.study]
    if options.study == 'certificate':
        return certificate_study(plants=options.plants, runs=runs, seed=options.seed)
    if options.study == 'promise':
        return promise_study(plants=options.plants, runs=runs, seed=options.seed)
    if options.study == 'threshold':
        if options.params_file:
            return own_plant.own_plant_study(
                load_scenario(options.params_file), runs=runs, seed=options.seed
            )
        return threshold_study(runs=runs, seed=options.seed)
    return pixels_study(runs=runs, seed=options.seed)


def _found(h: float) -> str:
    return f'{h:.4f}' if math.isfinite(h) else 'not one'


def _report(study: Study, rows: list[dict[str, str]]) -> int:
    if study.name == 'certificate':
        summary = summarize_certificate(rows)
        print(
            f'{summary.runs} runs over {summary.plants} plants: {summary.violations} violations, '
            f'tightest limsup/eps = {summary.tightest:.4f} ({summary.dark} runs left out: the '
            'luminosity tended to 0 in the transient)'
        )
        return 1 if summary.violations else 0
    if study.name == 'promise':
        promised = summarize_promise(rows)
        print(
            f'{promised.runs} sampled runs over {promised.plants} plants: {promised.violations} '
            f'violations, tightest limsup/eps = {promised.tightest:.4f} ({promised.dark} runs '
            f'left out: a luminosity was not positive in the transient, in '
            f'{promised.dark_though_promised} of them although promised to be; '
            f'{promised.unsettled} still falling)'
        )
        return 1 if promised.violations or promised.dark_though_promised else 0
    if study.name == own_plant.NAME:
        print('least h that left eps, and bounds on h (any, none):')
        print('method         random   adversarial   h*       h_certified')
        for own in own_plant.own_thresholds(rows):
            print(
                f'{own.method:12} {_found(own.random):>8}   {_found(own.adversarial):>11}   '
                f'{threshold_words(own.h_star):>7}  {threshold_words(own.h_certified):>7}'
            )
    if study.name == 'threshold':
        print('method        r   simulated   h*       h_certified')
        for line in critical_thresholds(rows):
            print(
                f'{line.method:12} {line.pixels:2d}   {line.simulated:9.4f}   {line.h_star:.4f}   '
                f'{line.h_certified:.4f}'
            )
    return 0
