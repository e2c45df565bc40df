"""Designs are found once and kept: the same bits, and found anew where anything differs."""

import dataclasses
import json
import math
import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from dvs_common.scenario.scenario import load_scenario
from dvs_hinf_controller.design import design, kept_designs
from dvs_hinf_controller.design.design import design_controller, design_from_scenario
from dvs_hinf_controller.design.kept_designs import kept
from dvs_hinf_controller.problem import DesignProblem
from dvs_hinf_controller.synthesis.options import DesignOptions

CONFIG = Path(__file__).resolve().parents[3] / 'config'
SCENARIOS = sorted(file.stem for file in CONFIG.glob('*.yaml'))
MIRROR = load_scenario(CONFIG / 'mirror_r3.yaml')


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """Where designs are kept in a test."""
    monkeypatch.setenv('DVS_CACHE', str(tmp_path))
    return tmp_path / 'designs'


class Asked:
    """Counts how often it has found an answer."""

    def __init__(self, answer=1.5):
        self.times, self.answer = 0, answer

    def __call__(self):
        self.times += 1
        return {'answer': self.answer}


def figures_of(found):
    """All figures but the time that it took, as text: NaN equals NaN."""
    return json.dumps({**dataclasses.asdict(found.figures), 'seconds': 0})


@pytest.mark.parametrize('name', ['mirror_r3', 'pendulum', 'real_sensor'])
def test_a_kept_design_is_the_one_that_was_found_to_the_last_bit(name, folder, monkeypatch):
    scenario = load_scenario(CONFIG / f'{name}.yaml')
    found = design_from_scenario(scenario)
    monkeypatch.setattr(design, 'design_controller', None)

    again = design_from_scenario(scenario)

    anew = design_controller(
        DesignProblem.from_scenario(scenario),
        method=scenario.controller.method,
        options=DesignOptions.from_scenario(scenario),
    )
    for field in dataclasses.fields(anew.controller):
        one, other = getattr(again.controller, field.name), getattr(anew.controller, field.name)
        assert one.tobytes() == other.tobytes()
        assert one.shape == other.shape
        assert one.flags.c_contiguous == other.flags.c_contiguous
    assert figures_of(again) == figures_of(anew) == figures_of(found)
    assert again.figures.seconds == found.figures.seconds
    assert len(list(folder.iterdir())) == 1


@pytest.mark.parametrize('name', SCENARIOS)
def test_the_question_of_every_scenario_has_a_name(name, folder):
    scenario = load_scenario(CONFIG / f'{name}.yaml')
    problem = DesignProblem.from_scenario(scenario)
    question = (problem, scenario.controller.method, DesignOptions.from_scenario(scenario))
    asked = Asked()

    for _ in range(2):
        assert kept(question, asked) == {'answer': 1.5}

    assert asked.times == 1


@pytest.mark.parametrize(
    'changes',
    [
        {'event_threshold': 0.07},
        {'tolerance': 0.06},
        {'method': 'structured'},
        {'gamma_slack': 2e-3},
        {'sampling_period': 0.002},
        {'initial_state': (0.2, 0.1)},
        {'pixel_offsets': (*MIRROR['pixel_offsets'][:-1], 1e-9)},
    ],
    ids=lambda changes: next(iter(changes)),
)
def test_another_question_is_answered_anew(changes, folder):
    design_from_scenario(MIRROR)

    design_from_scenario(MIRROR.replace(**changes))

    # The threshold of a loop is held against the design, and is no part of it.
    assert len(list(folder.iterdir())) == 1 + ('event_threshold' not in changes)


def test_values_of_another_kind_or_order_are_another_question(folder):
    asked = Asked()
    questions = [
        [1],
        [1.0],
        [True],
        ['1'],
        [(1,)],
        [[1]],
        [np.array([1])],
        [np.array([1.0])],
        [np.array([[1.0]])],
        [1, 2],
        [(1, 2)],
        [(1,), 2],
        ['a', 'bc'],
        ['ab', 'c'],
        [None],
        [-0.0],
        [0.0],
    ]

    for question in questions:
        kept(question, asked)

    assert asked.times == len(questions)


def test_an_answer_keeps_infinity_and_every_digit(folder):
    values = [math.inf, -math.inf, 0.1 + 0.2, 5e-324, -0.0]

    for _ in range(2):
        answer = kept(['digits'], Asked(values))['answer']
        assert [float(value).hex() for value in answer] == [value.hex() for value in values]


@pytest.mark.parametrize(
    'damage',
    [
        lambda data: b'',
        lambda data: data[:-1],
        lambda data: data.replace(b'1.5', b'1.6'),
        lambda data: b'\xff' + data,
        lambda data: data.split(b'\n')[0],
    ],
    ids=['empty', 'cut short', 'another digit', 'no text', 'no answer'],
)
def test_a_damaged_file_costs_a_design_only(damage, folder):
    asked = Asked()
    kept(['damaged'], asked)
    (file,) = folder.iterdir()
    whole = file.read_bytes()
    file.write_bytes(damage(whole))

    assert kept(['damaged'], asked) == {'answer': 1.5}

    assert asked.times == 2
    assert file.read_bytes() == whole


@pytest.mark.parametrize('question', [[object()], [{'a': 1}], [lambda: 1]])
def test_what_has_no_name_is_found_each_time(question, folder):
    asked = Asked()

    for _ in range(2):
        assert kept(question, asked) == {'answer': 1.5}

    assert asked.times == 2
    assert not folder.exists()


def test_without_a_folder_that_can_be_written_a_design_is_found_each_time(tmp_path, monkeypatch):
    (tmp_path / 'file').touch()
    for folder in ('', str(tmp_path / 'file')):
        monkeypatch.setenv('DVS_CACHE', folder)
        asked = Asked()
        for _ in range(2):
            assert kept(['nowhere'], asked) == {'answer': 1.5}
        assert asked.times == 2


@pytest.mark.parametrize(
    ('xdg', 'home', 'expected'),
    [
        ('XDG', 'HOME', 'XDG/dvs/designs'),
        ('', 'HOME', 'HOME/.cache/dvs/designs'),
        ('not/absolute', 'HOME', 'HOME/.cache/dvs/designs'),
        ('', 'HOME/that/is/not/there', None),
    ],
)
def test_the_folder_is_the_users_cache_unless_named(xdg, home, expected, tmp_path, monkeypatch):
    monkeypatch.delenv('DVS_CACHE')
    monkeypatch.chdir(tmp_path)
    for folder in ('XDG', 'HOME'):
        (tmp_path / folder).mkdir()
    monkeypatch.setenv('XDG_CACHE_HOME', xdg.replace('XDG', str(tmp_path / 'XDG')))
    monkeypatch.setenv('HOME', str(tmp_path / home))

    assert kept(['here'], Asked()) == {'answer': 1.5}

    written = [path.parent.relative_to(tmp_path) for path in tmp_path.rglob('*.json')]
    assert written == ([Path(expected)] if expected else [])
    assert {path.name for path in tmp_path.iterdir()} == {'XDG', 'HOME'}


def test_the_oldest_go_when_there_are_many(folder, monkeypatch):
    monkeypatch.setattr(kept_designs, '_MOST_KEPT', 3)
    for number in range(5):
        before = set(folder.glob('*'))
        kept([number], Asked())
        for file in set(folder.glob('*')) - before:
            os.utime(file, (number, number))

    assert sorted(file.stat().st_mtime for file in folder.iterdir()) == [2, 3, 4]


@pytest.mark.ensemble
def test_a_change_of_the_code_finds_every_design_anew(folder, tmp_path):
    source = tmp_path / 'source'
    for package in ('dvs_common', 'dvs_hinf_controller'):
        shutil.copytree(
            CONFIG.parent / 'src' / package / package,
            source / package,
            ignore=shutil.ignore_patterns('__pycache__'),
        )
    program = (
        'from dvs_hinf_controller.design.kept_designs import kept\n'
        "kept(['question'], lambda: print('found') or {})\n"
    )

    def found():
        run = subprocess.run(
            [sys.executable, '-c', program],
            env={**os.environ, 'PYTHONPATH': str(source), 'PYTHONDONTWRITEBYTECODE': '1'},
            capture_output=True,
            text=True,
            check=True,
        )
        return run.stdout == 'found\n'

    assert [found(), found()] == [True, False]
    for file in ('dvs_common/arrays.py', 'dvs_hinf_controller/analysis/peak_gain.py'):
        with (source / file).open('a') as code:
            code.write('# changed\n')
        assert [found(), found()] == [True, False]
