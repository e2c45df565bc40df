"""Everything of the paper into one directory: figures, table, animation, report."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from tqdm import tqdm

from dvs_common.drawing import Figure
from dvs_common.output_folder import output_folder
from dvs_simulation import plotting
from dvs_simulation.paper import corrections, figures
from dvs_simulation.paper.animation import animate_platform
from dvs_simulation.paper.experiments import (
    Counterexample,
    Experiment,
    ThresholdCurve,
    run_counterexample,
    run_example,
    run_platform,
    threshold_curve,
)
from dvs_simulation.paper.report import Picture, write_report
from dvs_simulation.paper.story import CAPTIONS, sections
from dvs_simulation.paper.table import Experiments, TableRow, paper_table, write_table

_CURVES = ('unstructured', 'structured', 'certified')
_RUNS: tuple[tuple[Any, int, str], ...] = (
    ('paper', 1, 'structured'),
    ('paper', 3, 'structured'),
    ('paper', 9, 'structured'),
    ('paper', 3, 'unstructured'),
    ('mirror', 1, 'structured'),
    ('mirror', 3, 'structured'),
    ('mirror', 9, 'structured'),
)


class Results:
    """What the steps leave for each other.

    Attributes
    ----------
    experiments
        Runs by (example, r, method).
    curves
        Error against h by method.
    counterexample
        Run of the loop that the theorems allow, once it has been run.
    platform
        Run of the platform example, once it has been run.
    """

    def __init__(self) -> None:
        self.experiments: Experiments = {}
        self.curves: list[ThresholdCurve] = []
        self.counterexample: Counterexample | None = None
        self.platform: Experiment | None = None


def reproduce_paper(
    output: Path, *, progress: bool = True, animation_frames: int = 100
) -> list[TableRow]:
    """Regenerate the paper into `output`: `report.html`, `table.csv`, figures, `platform.gif`.

    Parameters
    ----------
    output
        Directory; made if it is not there.
    progress
        Whether to show a progress bar.
    animation_frames
        Frames of the animation.

    Returns
    -------
    list of TableRow
        The table.

    Raises
    ------
    ParameterError
        If `output` can't be made.
    """
    output_folder(output)
    results = Results()
    steps = _steps(results, output, animation_frames)
    with plotting.in_style(), tqdm(steps, disable=not progress, unit='step') as bar:
        for name, step in bar:
            bar.set_description(name)
            step()
    assert results.counterexample is not None
    rows = paper_table(results.experiments, results.counterexample)
    write_table(rows, output / 'table.csv')
    pictures = {
        name: Picture(file=_file(output, name), caption=caption)
        for name, caption in CAPTIONS.items()
    }
    write_report(
        sections(results.experiments, results.counterexample, results.curves, pictures),
        rows,
        output / 'report.html',
    )
    return rows


def _file(output: Path, name: str) -> Path:
    return output / (f'{name}.gif' if name == 'platform' else f'{name}.png')


def _steps(
    results: Results, output: Path, animation_frames: int
) -> list[tuple[str, Callable[[], None]]]:
    steps: list[tuple[str, Callable[[], None]]] = []
    for key in _RUNS:
        steps.append((f'run {key[0]}, r = {key[1]}', _run_step(results, key)))
    steps.append(('counterexample', lambda: _set(results, 'counterexample', run_counterexample())))
    steps.append(('platform', lambda: _set(results, 'platform', run_platform())))
    for method in _CURVES:
        steps.append((f'thresholds, {method}', _curve_step(results, method)))
    for name, draw in _DRAWINGS.items():
        steps.append((f'figure {name}', _drawing_step(results, draw, output / f'{name}.png')))
    steps.append(
        (
            'animation',
            lambda: animate_platform(
                _wanted(results.platform), output / 'platform.gif', frames=animation_frames
            ),
        )
    )
    return steps


def _run_step(results: Results, key: tuple[Any, int, str]) -> Callable[[], None]:
    return lambda: results.experiments.__setitem__(key, run_example(*key))


def _curve_step(results: Results, method: str) -> Callable[[], None]:
    return lambda: results.curves.append(threshold_curve(method))


def _drawing_step(
    results: Results, draw: Callable[[Results], Figure], path: Path
) -> Callable[[], None]:
    return lambda: plotting.save_figure(draw(results), path, dpi=150)


def _set(results: Results, name: str, value: object) -> None:
    setattr(results, name, value)


def _wanted(value: Any) -> Any:
    assert value is not None
    return value


def _methods(results: Results) -> dict[str, Experiment]:
    return {m: results.experiments['paper', 3, m] for m in ('unstructured', 'structured')}


def _pixels(results: Results) -> dict[str, Experiment]:
    return {f'r = {r}': results.experiments['paper', r, 'structured'] for r in (1, 3, 9)}


_PIXEL_COLOURS = {f'r = {r}': colour for r, colour in figures.PIXEL_COLOURS.items()}

_DRAWINGS: dict[str, Callable[[Results], Figure]] = {
    'pixel_grid': lambda r: figures.pixel_grid(),
    'staircase': lambda r: figures.staircase(r.experiments['mirror', 3, 'structured']),
    'sector': lambda r: figures.sector_plot(),
    'optimization': lambda r: figures.optimization(),
    'error_methods': lambda r: figures.errors(
        _methods(r), figures.METHOD_COLOURS, 'Two controllers, r = 3'
    ),
    'phase_methods': lambda r: figures.phase_portrait(
        _methods(r), figures.METHOD_COLOURS, 'Two controllers, r = 3'
    ),
    'bode': lambda r: figures.bode(_methods(r)),
    'error_pixels': lambda r: figures.errors(_pixels(r), _PIXEL_COLOURS, 'Structured controller'),
    'phase_pixels': lambda r: figures.phase_portrait(
        _pixels(r), _PIXEL_COLOURS, 'Structured controller'
    ),
    'positivity': lambda r: corrections.positivity(
        r.experiments['paper', 1, 'structured'], r.experiments['mirror', 1, 'structured']
    ),
    'small_gain': lambda r: corrections.small_gain(
        _wanted(r.counterexample),
        corrections.counterexample_gain(_wanted(r.counterexample)),
    ),
    'counterexample': lambda r: corrections.counterexample_plot(_wanted(r.counterexample)),
    'certificate': lambda r: corrections.certificate(r.curves),
}
