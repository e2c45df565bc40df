"""The report of a recorded run as one HTML page that needs no network."""

from __future__ import annotations

import base64
import platform
from collections.abc import Mapping, Sequence
from html import escape
from importlib.metadata import version

from dvs_closed_loop.bags.bag import RecordedBag
from dvs_closed_loop.bags.recorded_run import RecordedRun
from dvs_common.scenario.parameters import SCHEMA
from dvs_common.scenario.scenario import Scenario
from dvs_simulation.judging.verdict import Verdict

_STYLE = """
:root { color-scheme: light dark; --ink: #17202a; --soft: #5b6773; --paper: #f4f6f8; --card: #fff;
  --line: #dde3e8; --good: #00755a; --bad: #b04a00; }
@media (prefers-color-scheme: dark) { :root { --ink: #e6edf3; --soft: #98a5b3; --paper: #0e141b;
  --card: #161e27; --line: #2a3541; --good: #35c9a3; --bad: #ff9d5c; } }
* { box-sizing: border-box; }
body { margin: 0 auto; max-width: 76rem; padding: 2rem 1.2rem 4rem; background: var(--paper);
  color: var(--ink); font: 15px/1.5 system-ui, sans-serif; }
h1 { font-size: 1.7rem; margin: 0 0 .2rem; } h2 { font-size: 1.15rem; margin: 2.2rem 0 .7rem; }
.sub { color: var(--soft); margin: 0 0 1.4rem; overflow-wrap: anywhere; }
.badge { display: inline-block; border: 2px solid currentColor; border-radius: 2rem;
  padding: .1rem .8rem; font-weight: 650; }
.good { color: var(--good); } .bad { color: var(--bad); }
.tiles { display: grid; gap: .8rem; margin: 1.2rem 0;
  grid-template-columns: repeat(auto-fit, minmax(11rem, 1fr)); }
.tile { background: var(--card); border: 1px solid var(--line); border-radius: .6rem;
  padding: .7rem .9rem; }
.tile b { display: block; font-size: 1.35rem; font-variant-numeric: tabular-nums; }
.tile span { color: var(--soft); font-size: .85rem; }
.figures { display: grid; gap: 1rem;
  grid-template-columns: repeat(auto-fit, minmax(min(30rem, 100%), 1fr)); }
.figures img { width: 100%; height: auto; background: #fff; border: 1px solid var(--line);
  border-radius: .6rem; }
.wide { overflow-x: auto; }
table { border-collapse: collapse; width: 100%; background: var(--card); font-size: .92rem; }
th, td { padding: .35rem .7rem; border-bottom: 1px solid var(--line); text-align: left; }
td.n, th.n { text-align: right; font-variant-numeric: tabular-nums; }
td.v { font-family: ui-monospace, monospace; overflow-wrap: anywhere; }
summary { cursor: pointer; font-weight: 600; } .note { border-left: 4px solid var(--bad);
  padding: .3rem .9rem; margin: .6rem 0; background: var(--card); }
"""


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
    images = ''.join(
        f'<img alt="{escape(title)}" src="data:image/svg+xml;base64,{_base64(svg)}">\n'
        for title, svg in figures.items()
    )
    notes = ''.join(
        f'<p class="note">{escape(note)}</p>' for note in _notes(bag, recorded, verdict)
    )
    return f"""<!DOCTYPE html>
<html lang="en"><head><meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>{escape(name)}: report</title><style>{_STYLE}</style></head><body>
<h1>{escape(name)} {_badge(verdict)}</h1>
<p class="sub">{escape(str(bag.path))}, written by {escape(bag.writer)}</p>
{notes}{_tiles(verdict)}
<div class="figures">{images}</div>
<h2>Messages</h2><div class="wide">{_stream_table(recorded)}</div>
<h2>Events</h2><div class="wide">{_event_table(recorded)}</div>
<h2>Scenario</h2><details><summary>{len(scenario.values)} parameters</summary>
<div class="wide">{_parameter_table(scenario)}</div></details>
<p class="sub">Python {platform.python_version()}, NumPy {version('numpy')},
rosbags {version('rosbags')}</p>
</body></html>
"""


def _base64(data: bytes) -> str:
    return base64.b64encode(data).decode('ascii')


def _badge(verdict: Verdict | None) -> str:
    if verdict is None:
        return '<span class="badge bad">no verdict</span>'
    word = 'regulated' if verdict.regulated else 'not regulated'
    word += ', interrupted' if verdict.interrupted else ''
    if not verdict.sector_held:
        word += ', sector bound violated'
    return f'<span class="badge {"good" if verdict.passed else "bad"}">{word}</span>'


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


def _tiles(verdict: Verdict | None) -> str:
    if verdict is None:
        return ''
    speed = verdict.simulated_seconds / max(verdict.wall_seconds, 1e-9)
    tiles = (
        (
            f'{verdict.limsup_error:.5f}',
            f'limsup ‖x − x_d‖, last third (ε = {verdict.tolerance:g})',
        ),
        (f'{verdict.final_error:.5f}', 'final ‖x − x_d‖'),
        (f'{verdict.sector_ratio_max:.5f}', 'worst |z − y| / (δ_z |y|), must be ≤ 1'),
        (f'{verdict.h:g}', f'threshold h (published bound h* = {verdict.h_star:.4f})'),
        (f'{verdict.events:,}', f'events, {verdict.events_per_pixel:.1f} a pixel'),
        (f'{verdict.pixels:,}', 'pixels r'),
        (
            f'{verdict.cycles:,}',
            f'cycles, {verdict.cycles_per_second:.0f} a second, '
            f'{verdict.samples_skipped} samples skipped',
        ),
        (f'{verdict.simulated_seconds:.3g} s', f'simulated, {speed:.2f} × real time'),
    )
    body = ''.join(
        f'<div class="tile"><b>{escape(value)}</b><span>{escape(label)}</span></div>'
        for value, label in tiles
    )
    return f'<div class="tiles">{body}</div>'


def _stream_table(recorded: RecordedRun) -> str:
    rows = [
        (
            escape(stream.topic),
            escape(stream.type_name),
            f'{stream.messages:,}',
            f'{stream.rate_hz:.1f}',
            f'{stream.longest_pause_s * 1e3:.1f}',
            f'{stream.size_bytes / 1e6:.2f}',
            '–' if stream.missing is None else str(stream.missing),
        )
        for stream in recorded.streams.values()
    ]
    heads = ('topic', 'type', 'messages', 'Hz', 'longest pause [ms]', 'MB', 'missing samples')
    return _table(heads, rows, numbers=range(2, 7))


def _event_table(recorded: RecordedRun) -> str:
    index = recorded.index
    share = f'{100 * index.on_events / index.events:.1f} %' if index.events else '–'
    rows = [
        ('events', f'{index.events:,}'),
        ('share of ON', share),
        ('lost, by the running index', f'{index.lost:,} in {index.gaps} gaps'),
        ('first index', '–' if index.first_index is None else str(index.first_index)),
        ('restarts of the camera', str(index.restarts)),
    ]
    return _table(('events on the way', 'number'), rows, numbers=(1,))


def _parameter_table(scenario: Scenario) -> str:
    rows = []
    for name, value in scenario.values.items():
        spec = SCHEMA[name]
        text = ', '.join(f'{v:g}' for v in value) if isinstance(value, tuple) else str(value)
        rows.append((name, escape(text), escape(spec.unit), escape(spec.description)))
    return _table(('parameter', 'value', 'unit', 'meaning'), rows, numbers=())


def _table(heads: Sequence[str], rows: Sequence[Sequence[str]], *, numbers: Sequence[int]) -> str:
    """HTML table of cells that are escaped already."""

    def line(tag: str, cells: Sequence[str]) -> str:
        return ''.join(
            f'<{tag}{" class=n" if i in numbers else ""}>{cell}</{tag}>'
            for i, cell in enumerate(cells)
        )

    body = ''.join(f'<tr>{line("td", row)}</tr>' for row in rows)
    return f'<table><thead><tr>{line("th", heads)}</tr></thead><tbody>{body}</tbody></table>'
