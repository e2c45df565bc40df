"""The report of a recorded run as one HTML page that needs no network."""

from __future__ import annotations

import base64
import platform
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import version

from dvs_closed_loop.bags.bag import RecordedBag
from dvs_closed_loop.bags.recorded_run import RecordedRun
from dvs_common.scenario.parameters import SCHEMA
from dvs_common.scenario.scenario import Scenario
from dvs_simulation.html_page import page
from dvs_simulation.judging.verdict import Verdict


@dataclass(frozen=True, slots=True, kw_only=True)
class _Table:
    heads: tuple[str, ...]
    rows: Sequence[Sequence[str]]
    numbers: tuple[int, ...] = ()


def report_page(
    *,
    bag: RecordedBag,
    recorded: RecordedRun,
    scenario: Scenario,
    name: str,
    verdict: Verdict | None,
    figures: Mapping[str, bytes],
) -> str:
    """HTML text of the report.

    Parameters
    ----------
    bag
        The bag.
    recorded
        What is in it.
    scenario
        Parameters of the run.
    name
        Name of the scenario.
    verdict
        Figures of the run, or None if no sample was recorded whole.
    figures
        SVG documents by title.
    """
    return page(
        'dvs_closed_loop.reports',
        'report.html.j2',
        name=name,
        passed=verdict is not None and verdict.passed,
        badge=_badge(verdict),
        bag=bag,
        notes=_notes(bag, recorded, verdict),
        tiles=_tiles(verdict),
        pictures=[(title, _base64(svg)) for title, svg in figures.items()],
        messages=_stream_table(recorded),
        events=_event_table(recorded),
        parameters=_parameter_table(scenario),
        versions=f'Python {platform.python_version()}, NumPy {version("numpy")}, '
        f'rosbags {version("rosbags")}',
    )


def _base64(data: bytes) -> str:
    return base64.b64encode(data).decode('ascii')


def _badge(verdict: Verdict | None) -> str:
    if verdict is None:
        return 'no verdict'
    word = verdict.word
    if not verdict.sector_held:
        word += ', sector bound violated'
    return word


def _notes(bag: RecordedBag, recorded: RecordedRun, verdict: Verdict | None) -> list[str]:
    notes = []
    if verdict is None:
        missing = [topic for topic, stream in recorded.streams.items() if not stream.messages]
        notes.append(
            'No sample of the run was recorded with luminosity, events, command, state and '
            f'estimate, so there are no figures. Empty topics: {", ".join(missing) or "none"}.'
        )
    elif not recorded.from_start:
        notes.append(
            'The recording does not begin with the run: the bounds of the initial references are '
            'those of initial_state, and times count from the first complete sample.'
        )
    notes += recorded.troubles
    if bag.ignored:
        notes.append(f'Topics not of this loop: {", ".join(bag.ignored)}.')
    return notes


def _tiles(verdict: Verdict | None) -> tuple[tuple[str, str], ...]:
    if verdict is None:
        return ()
    speed = verdict.simulated_seconds / max(verdict.wall_seconds, 1e-9)
    return (
        (
            f'{verdict.limsup_error:.5f}',
            f'limsup ‖x − x_d‖, last third (ε = {verdict.tolerance:g})',
        ),
        (f'{verdict.final_error:.5f}', 'final ‖x − x_d‖'),
        (f'{verdict.sector_ratio_max:.5f}', 'worst |z − y| / (δ_z |y|), must be ≤ 1'),
        (
            f'{verdict.h:g}',
            f'threshold h, {verdict.promise} (h_certified = {verdict.certified_text}, h* = '
            f'{verdict.published_text})',
        ),
        (
            f'{verdict.budget_used:.4g}',
            'h ln b + max w, atanh(δ_certified) = '
            f'{_or_any(verdict.budget_allowed)}: {verdict.certificate.partition(":")[0]}',
        ),
        (f'{verdict.events:,}', f'events, {verdict.events_per_pixel:.1f} a pixel'),
        (f'{verdict.pixels:,}', 'pixels r'),
        (
            f'{verdict.cycles:,}',
            f'cycles, {verdict.cycles_per_second:.0f} a second, '
            f'{verdict.samples_skipped} samples skipped',
        ),
        (f'{verdict.simulated_seconds:.3g} s', f'simulated, {speed:.2f} × real time'),
    )


def _or_any(allowed: float | None) -> str:
    return 'any' if allowed is None else f'{allowed:.4g}'


def _stream_table(recorded: RecordedRun) -> _Table:
    rows = [
        (
            stream.topic,
            stream.type_name,
            f'{stream.messages:,}',
            f'{stream.rate_hz:.1f}',
            f'{stream.longest_pause_s * 1e3:.1f}',
            f'{stream.size_bytes / 1e6:.2f}',
            '–' if stream.missing is None else str(stream.missing),
        )
        for stream in recorded.streams.values()
    ]
    heads = ('topic', 'type', 'messages', 'Hz', 'longest pause [ms]', 'MB', 'missing samples')
    return _Table(heads=heads, rows=rows, numbers=(2, 3, 4, 5, 6))


def _event_table(recorded: RecordedRun) -> _Table:
    index = recorded.index
    share = f'{100 * index.on_events / index.events:.1f} %' if index.events else '–'
    rows = [
        ('events', f'{index.events:,}'),
        ('share of ON', share),
        ('lost, by the running index', f'{index.lost:,} in {index.gaps} gaps'),
        ('first index', '–' if index.first_index is None else str(index.first_index)),
        ('restarts of the camera', str(index.restarts)),
    ]
    return _Table(heads=('events on the way', 'number'), rows=rows, numbers=(1,))


def _parameter_table(scenario: Scenario) -> _Table:
    rows = []
    for name, value in scenario.values.items():
        spec = SCHEMA[name]
        text = ', '.join(f'{v:g}' for v in value) if isinstance(value, tuple) else str(value)
        rows.append((name, text, spec.unit, spec.description))
    return _Table(heads=('parameter', 'value', 'unit', 'meaning'), rows=rows)
