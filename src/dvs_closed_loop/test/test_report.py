"""The report of a bag is one page that needs nothing else."""

import html.parser
import json
import re

import pytest
from recording_cases import TYPES, small_run, write_like_rosbag2

from dvs_closed_loop.bags.recording import BagWriter
from dvs_closed_loop.cli import main
from dvs_common.scenario.scenario import Scenario
from dvs_common.wire import topics

SCENARIO = Scenario.from_values({'duration': 0.59, 'sampling_period': 0.01})


class References(html.parser.HTMLParser):
    """Gathers what a page would load, and its visible words."""

    def __init__(self):
        super().__init__()
        self.loaded = []
        self.open = []

    def handle_starttag(self, tag, attributes):
        self.loaded += [v for k, v in attributes if k in ('src', 'href', 'action', 'data')]
        if tag not in ('meta', 'img', 'link', 'br'):
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag


def page_of(path):
    text = path.read_text(encoding='utf-8')
    references = References()
    references.feed(text)
    assert references.open == []
    assert all(value.startswith('data:image/svg+xml;base64,') for value in references.loaded)
    assert 'url(' not in text and '@import' not in text and '<script' not in text
    return text, references


@pytest.fixture
def bag(tmp_path):
    path = tmp_path / 'bag'
    with BagWriter(path, TYPES) as writer:
        writer.keep_scenario(SCENARIO, 'a <name> & more')
        for topic, received, data in small_run():
            writer.write(topic, received, data)
    return path


def test_a_report_of_our_bag(bag, tmp_path, capsys):
    assert main(['report', str(bag)]) == 0

    text, references = page_of(tmp_path / 'report.html')
    assert len(references.loaded) == 6
    assert 'a &lt;name&gt; &amp; more' in text
    assert '>regulated<' in text
    assert re.search(r'/events</td><td>sensor_msgs/msg/PointCloud2</td><td class=n>60<', text)
    assert (tmp_path / 'report.png').stat().st_size > 10_000
    assert 'regulated' in capsys.readouterr().out


def test_a_second_report_of_a_bag_has_the_same_figures(bag, tmp_path):
    figures = []
    for _ in range(2):
        assert main(['report', str(bag)]) == 0
        figures.append(page_of(tmp_path / 'report.html')[1].loaded)

    assert figures[0] == figures[1]


@pytest.mark.parametrize('storage', ['mcap', 'sqlite3'])
def test_a_report_of_a_bag_by_rosbag2(storage, tmp_path, capsys):
    folder = write_like_rosbag2(tmp_path / 'theirs', storage, small_run())
    parameters = {
        name: list(v) if isinstance(v, tuple) else v for name, v in SCENARIO.values.items()
    }
    scenario = tmp_path / 'scenario.yaml'
    scenario.write_text(json.dumps({'/**': {'ros__parameters': parameters}}))

    assert main(['report', str(folder)]) == 2
    assert 'params-file' in capsys.readouterr().err
    options = ['--params-file', str(scenario), '--output', str(tmp_path / 'out')]
    assert main(['report', str(folder), *options]) == 0

    text, _ = page_of(tmp_path / 'out' / 'scenario' / 'report.html')
    assert '>regulated<' in text
    assert 'written by jazzy' in text


def test_a_bag_without_states_is_reported_without_a_verdict(tmp_path, capsys):
    path = tmp_path / 'bag'
    with BagWriter(path, TYPES) as writer:
        writer.keep_scenario(SCENARIO, 'half')
        for topic, received, data in small_run():
            if topic != topics.STATE:
                writer.write(topic, received, data)

    assert main(['report', str(path)]) == 0

    text, _ = page_of(tmp_path / 'report.html')
    assert 'no verdict' in text
    assert 'Empty topics' in text and 'state' in text
    printed = capsys.readouterr().out
    assert 'half: no verdict: the plant publishes no state' in printed
    assert 'sector bound         held' in printed and '60 cycles, 0.59 s' in printed


@pytest.mark.parametrize('topic', [topics.STATE, topics.EVENTS, topics.LUMINOSITY])
def test_what_a_recorder_lost_is_not_laid_to_the_loop(topic, tmp_path, capsys):
    path = tmp_path / 'bag'
    kept = {}
    with BagWriter(path, TYPES) as writer:
        writer.keep_scenario(SCENARIO, 'holed')
        for name, received, data in small_run():
            kept[name] = kept.get(name, 0) + 1
            if name != topic or kept[name] not in (20, 21, 40):
                writer.write(name, received, data)

    assert main(['report', str(path)]) == 0

    printed = capsys.readouterr().out
    assert 'holed: regulated' in printed
    assert 'samples skipped' not in printed
    assert f'{topic}: 3 samples that other topics have are missing: lost by the rec' in printed
    lost = [line for line in printed.splitlines() if 'events are missing' in line]
    assert len(lost) == (topic == topics.EVENTS)
    assert all('packets of which the recorder lost' in line for line in lost)


def test_samples_that_a_plant_skipped_are_reported_as_skipped(tmp_path, capsys):
    path = tmp_path / 'bag'
    kept = {}
    with BagWriter(path, TYPES) as writer:
        writer.keep_scenario(SCENARIO, 'slow')
        for name, received, data in small_run():
            kept[name] = kept.get(name, 0) + 1
            if kept[name] not in (20, 21):
                writer.write(name, received, data)

    assert main(['report', str(path)]) == 0
    assert '2 samples skipped' in capsys.readouterr().out


def test_what_is_no_bag_is_one_line_on_stderr(tmp_path, capsys):
    assert main(['report', str(tmp_path / 'nothing')]) == 2

    assert capsys.readouterr().err.count('\n') == 1
