"""What README.md and docs/ tell a reader to type: each command has a rule on how to try it.

`test_documented_commands` runs the ``bash`` blocks as they are. Here are the rest: ``console``
blocks, commands that would recurse, blocks that need another machine, and commands in sentences.
"""

from __future__ import annotations

import re
import shlex
import subprocess
import urllib.request
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import pytest
import yaml
from ament_index_python.packages import get_package_prefix
from documentation import blocks_of, named_in_text
from lifecycle_msgs.msg import Transition
from loop_support import ROOT, environment, stop, wait_for
from test_documented_commands import PAGES, WITH_COMMANDS, name_of, sandbox

from dvs_closed_loop.cli import COMMANDS
from dvs_closed_loop.running.launch_plan import ARGUMENTS, launch_plan
from dvs_common.scenario.parameters import CAMERA, CONTROLLER, PLANT, SCHEMA
from dvs_common.wire import topics

RUN = r'scripts/run\.sh '
TOOLS = RUN + r'(?:dvs_closed_loop dvs_closed_loop|dvs_simulation dvs_simulation) '
UNKNOWN_OPTION = '--no-such-option'


@dataclass
class Running:
    process: subprocess.Popen
    log: Path
    proof: str

    def output(self) -> str:
        return self.log.read_text(encoding='utf-8')


class Reader:
    """Types commands in a copy of the checkout; what runs on ends with the block."""

    def __init__(self, folder: Path, domain: int, processes: list) -> None:
        self.folder = folder
        self._domain = domain
        self._processes = processes
        self._running: list[Running] = []
        self.tried: set[str] = set()

    def run(self, command: str) -> subprocess.CompletedProcess:
        return subprocess.run(
            ['bash', '-eo', 'pipefail', '-c', command],
            cwd=self.folder,
            env=environment(self._domain),
            capture_output=True,
            text=True,
            stdin=subprocess.DEVNULL,
            timeout=120,
        )

    def start(self, command: str, proof: str) -> Running:
        log = self.folder / f'log{len(self._processes)}'
        with log.open('w') as output:
            process = subprocess.Popen(
                ['bash', '-c', f'exec {command}'],
                cwd=self.folder,
                env={**environment(self._domain), 'PYTHONUNBUFFERED': '1'},
                stdout=output,
                stderr=subprocess.STDOUT,
                stdin=subprocess.DEVNULL,
                start_new_session=True,
            )
        self._processes.append(process)
        self._running.append(Running(process, log, proof))
        return self._running[-1]

    def finish(self) -> None:
        for running in self._running:
            assert wait_for(lambda r=running: re.search(r.proof, r.output())), running.output()
        while self._running:
            running = self._running.pop()
            code, _ = stop(running.process)
            assert code == 0, running.output()
            assert 'Traceback' not in running.output(), running.output()


Check = Callable[[Reader, str], None]


def runs(extra: str = '') -> Check:
    def check(reader, command):
        done = reader.run(f'{command} {extra}')
        assert done.returncode == 0, done.stdout + done.stderr
        assert 'Traceback' not in done.stderr, done.stderr

    return check


def runs_once(reader, command):
    """Run it, but where a page has it in a block of commands, which is run as a whole."""
    if not any(command in block.lines for page in WITH_COMMANDS for block in blocks_of(page)):
        runs()(reader, command)


def runs_until_ctrl_c(proof: str = '', extra: str = '') -> Check:
    return lambda reader, command: reader.start(f'{command} {extra}', proof) and None


def is_understood(reader, command):
    """One option that cannot be known is the only thing that is wrong with the command."""
    done = reader.run(f'{command} {UNKNOWN_OPTION}')
    assert done.returncode == 2, done.stdout + done.stderr
    assert done.stderr.endswith(f'unrecognized arguments: {UNKNOWN_OPTION}\n'), done.stderr


def benchmark_is_understood(reader, command):
    is_understood(reader, command.replace('scripts/bench.sh', 'python scripts/bench.py'))


def explains_itself(reader, command):
    done = reader.run(f'{shlex.split(command)[0]} --help')
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith('usage: ')


def serves_a_page(reader, command):
    address = r'http://127\.0\.0\.1:\d+/'
    running = reader.start(f'{command} --port 0', address)
    assert wait_for(lambda: re.search(address, running.output())), running.output()
    url = re.search(address, running.output())[0]
    with urllib.request.urlopen(url, timeout=20) as page:
        assert '<html' in page.read().decode()


def goes_with_our_runner(reader, command):
    """`ros2 run` of a program of ours is scripts/run.sh where there is no ros2."""
    obey(reader, command.replace('ros2 run', 'scripts/run.sh', 1))


def is_launched(reader, command):
    package, file, *words = shlex.split(command)[2:]
    assert Path(get_package_prefix(package), 'share', package, 'launch', file).is_file()
    arguments = dict(word.split(':=', 1) for word in words)
    assert set(arguments) <= {argument.name for argument in ARGUMENTS}
    assert launch_plan(arguments).plant.executable == 'plant_sim'


def names_packages(reader, command):
    for word in shlex.split(command)[2:]:
        assert (ROOT / word.partition('[')[0] / 'setup.py').is_file()


def records_topics_of_the_loop(reader, command):
    words = shlex.split(command)
    profiles = ROOT / words[words.index('--qos-profile-overrides-path') + 1]
    names = {f'/{name.lstrip("/")}' for name in vars(topics).values() if isinstance(name, str)}
    assert {word for word in words if word.startswith('/')} <= names
    assert set(yaml.safe_load(profiles.read_text())) <= names


def nothing(reader, command):
    pass


def is_executable(reader, command):
    package, program = re.search(r'(dvs_\w+) (\w+|\.\.\.)', command).groups()
    folder = Path(get_package_prefix(package), 'lib', package)
    assert folder.is_dir()
    assert program == '...' or (folder / program).is_file()


def is_script(reader, command):
    assert (ROOT / shlex.split(command)[0]).is_file()


def is_subcommand(reader, command):
    assert shlex.split(command)[1] in COMMANDS


def is_transition(reader, command):
    node, label = re.search(r'set /(\w+) (\w+)', command).groups()
    assert node in (PLANT, CAMERA, CONTROLLER)
    assert hasattr(Transition, f'TRANSITION_{label.upper()}')


def is_topic(reader, command):
    assert command.split('/')[-1] in vars(topics).values()


@dataclass(frozen=True)
class Rule:
    """How commands of a form are tried, and why not simply run to their end."""

    pattern: str
    check: Check
    why: str = ''


CTRL_C = 'goes on until Ctrl-C'
TYPED = (
    Rule(
        RUN + 'dvs_plant_sim plant_sim',
        runs_until_ctrl_c('run of 0.2 s finished', '--ros-args -p duration:=0.2'),
        'shortened',
    ),
    Rule(RUN + 'dvs_event_camera event_camera( .*)?', runs_until_ctrl_c(), CTRL_C),
    Rule(
        RUN + 'dvs_hinf_controller hinf_controller( .*)?',
        runs_until_ctrl_c(r'event threshold h +0\.15'),
        CTRL_C,
    ),
    Rule(
        RUN + 'dvs_event_camera dvs_event_camera simulate_video .*',
        is_understood,
        'src/dvs_event_camera/test/test_simulate_video.py runs it on a small video',
    ),
    Rule(RUN + 'dvs_event_camera scene disc', runs_until_ctrl_c(), CTRL_C),
    Rule(
        RUN + 'dvs_event_camera show_events',
        runs_until_ctrl_c(r'(?m)^ +\d+ +\d+ +\d+ [+-]1$'),
        CTRL_C,
    ),
    Rule(
        "sed 's/cart_pole_node.*|MUJOCO_GL=.*",
        nothing,
        'needs EGL or OSMesa; test_mujoco_cart_pole.py runs it where there is one',
    ),
    Rule(
        RUN + r'dvs_closed_loop closed_loop --params-file config/(?!mirror_r3)\w+\.yaml',
        is_understood,
        'test_scenarios.py runs all of these',
    ),
    Rule(RUN + 'dvs_closed_loop closed_loop .*', runs('--duration 0.2'), 'shortened'),
    Rule(
        RUN + r'dvs_hinf_controller design_controller --params-file config/textbook/(?!heading).*',
        is_understood,
        'like the heading; src/dvs_simulation/test/test_textbook_plants.py makes these columns',
    ),
    Rule(RUN + 'dvs_hinf_controller design_controller .*', runs_once),
    Rule(TOOLS + 'simulate .*', runs('--duration 0.1'), 'shortened: takes half a minute'),
    Rule(
        TOOLS + 'sweep .*',
        runs('--runs 1 --plants 1 --workers 1 --seed 4'),
        'shortened: takes hours; a seed whose plant is quickly designed for',
    ),
    Rule(
        TOOLS + 'reproduce_paper .*',
        is_understood,
        'takes half a minute; src/dvs_simulation/test/test_paper.py runs it with fewer pictures',
    ),
    Rule(TOOLS + 'dashboard', serves_a_page, CTRL_C),
    Rule(TOOLS + 'record .*', runs_until_ctrl_c(r'receives command'), CTRL_C),
    Rule(TOOLS + 'play recording.raw .*', is_understood, 'test_recorded_stream.py plays files'),
    Rule(TOOLS + '(play|report) .*', runs()),
    Rule(r'scripts/bench\.sh( .*)?', benchmark_is_understood, 'takes minutes, installs packages'),
    Rule(
        r'scripts/(demo|test|setup)\.sh( --\w+)?',
        explains_itself,
        'sets up, and this is one of the tests',
    ),
    Rule(RUN + r'\.venv/bin/python -m pytest .*', runs()),
    Rule(
        r'\.venv/bin/python -m pip install .*',
        nothing,
        'test_mujoco_cart_pole.py needs what it installs',
    ),
    Rule('pip install .*', names_packages, 'test_library.py installs them elsewhere'),
    Rule(r'ros2 run dvs_\w+ .*', goes_with_our_runner, 'ros2 comes with ROS from apt only'),
    Rule('ros2 bag record .*', records_topics_of_the_loop, 'ros2 comes with ROS from apt only'),
    Rule('ros2 bag (play|convert) .*', nothing, 'ros2 comes with ROS from apt only'),
    Rule('(export ROS_SECURITY|ros2 security ).*', nothing, 'sros2 comes with ROS from apt only'),
    Rule('ros2 launch .*', is_launched, 'ros2 comes with ROS from apt only'),
    Rule('git clone .*', nothing, 'needs the network; the clones are raced by hand'),
    Rule(
        RUN + r'\.venv/bin/python scripts/bench_camera\.py .*', is_understood, 'needs the clones'
    ),
)
NAMED = (
    Rule(
        'ros2 (run|launch|topic( echo)?|lifecycle|security|param( [gs]et)?'
        '|bag( (record|play|convert))?)',
        nothing,
        'no whole command',
    ),
    Rule(r'ros2 run dvs_\w+ .*', is_executable, 'ros2 comes with ROS from apt only'),
    Rule('ros2 run plotjuggler .*', nothing, 'PlotJuggler comes with ROS from apt only'),
    Rule('rqt --perspective-file FILE', nothing, 'rqt comes with ROS from apt only'),
    Rule('ros2 lifecycle set .*', is_transition, 'ros2 comes with ROS from apt only'),
    Rule('ros2 topic echo .*', is_topic, 'ros2 comes with ROS from apt only'),
    Rule(RUN + '.*', is_executable, 'part of a command'),
    Rule(
        r'scripts/\w+\.(sh|py)( loop| hop| scale| events| --fast| --long| --quick)?',
        is_script,
        'makes figures, or is in a block too',
    ),
    Rule(r'dvs_closed_loop \w+', is_subcommand, 'part of a command'),
    Rule(r'source install/setup\.bash', runs()),
    Rule('pip install', nothing, 'no whole command'),
    Rule('colcon test', nothing, 'test_manifests.py runs it'),
    Rule('apt-get install chromium chromium-driver', nothing, 'system packages; .ci/run has them'),
    Rule('timeout -s INT|kill -9|tc netem', nothing, 'no whole command'),
)


def rule_of(command: str, rules: tuple[Rule, ...]) -> Rule:
    found = next((rule for rule in rules if re.fullmatch(rule.pattern, command)), None)
    assert found is not None, f'no rule in {Path(__file__).name} says how to try "{command}"'
    return found


def obey(reader: Reader, command: str) -> None:
    if command not in reader.tried:
        reader.tried.add(command)
        rule_of(command, TYPED).check(reader, command)


def groups_of(page: Path) -> list[list[str]]:
    """Commands that are typed together: console blocks; what is not run of the bash blocks."""
    blocks = blocks_of(page)
    groups = [block.typed for block in blocks if block.language == 'console']
    return [
        g for g in (*groups, [c for b in blocks if b.language == 'bash' for c in b.typed]) if g
    ]


def trials() -> list:
    """Pages with the groups in which some command is not of a page before them."""
    seen: set[str] = set()
    found = []
    for page in PAGES:
        groups = [group for group in groups_of(page) if not seen.issuperset(group)]
        seen.update(*groups)
        if groups:
            found.append(pytest.param(groups, id=name_of(page)))
    return found


@pytest.mark.parametrize('groups', trials())
def test_what_a_page_has_typed_works(groups, new_domain, processes, tmp_path):
    folder = sandbox(tmp_path / 'checkout')
    for group in groups:
        reader = Reader(folder, new_domain(), processes)
        for command in group:
            obey(reader, command)
        reader.finish()


@pytest.mark.parametrize('page', PAGES, ids=name_of)
def test_what_a_page_names_exists(page, domain, tmp_path):
    reader = Reader(sandbox(tmp_path / 'checkout'), domain, [])
    for command in named_in_text(page):
        rule_of(command, NAMED).check(reader, command)


@pytest.mark.parametrize('page', PAGES, ids=name_of)
def test_commands_stand_in_blocks_of_commands(page):
    assert [line for block in blocks_of(page) for line in block.stray] == []


@pytest.mark.parametrize('page', PAGES, ids=name_of)
def test_parameters_that_a_page_sets_exist(page):
    names = re.findall(r'-p (\w[\w.]*):=', page.read_text(encoding='utf-8'))
    assert set(names) <= {*SCHEMA, 'use_sim_time'}


def test_every_rule_is_needed_and_has_a_reason():
    typed = [command for page in PAGES for group in groups_of(page) for command in group]
    named = [command for page in PAGES for command in named_in_text(page)]
    for rules, commands in ((TYPED, typed), (NAMED, named)):
        used = [rule_of(command, rules) for command in commands]
        assert [rule for rule in rules if rule not in used] == []
        assert all(rule.why or rule.check.__qualname__.startswith('runs') for rule in rules)


def test_an_unknown_command_is_refused():
    with pytest.raises(AssertionError, match='no rule'):
        rule_of('sudo reboot', TYPED)
