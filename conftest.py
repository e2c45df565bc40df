"""What all tests share: examples that are the same at every run, and ROS domains of their own."""

import contextlib
import fcntl
import gc
import itertools
import os
import shutil
import signal
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from hypothesis import settings

# No test measures time.
settings.register_profile('suite', deadline=None, max_examples=50, derandomize=True)
settings.load_profile('suite')

os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'
# Hundreds of processes import the same modules: what one has compiled, the others load.
os.environ.pop('PYTHONDONTWRITEBYTECODE', None)
sys.dont_write_bytecode = False
# Under nohup SIGHUP is ignored, in the background of a script SIGINT; programs leave that so.
signal.signal(signal.SIGHUP, signal.SIG_DFL)
signal.signal(signal.SIGINT, signal.default_int_handler)
# Designs that a test has kept may be of code that it has changed: they are not for the user. All
# workers of a run share them.
_OWN_CACHE = None if 'DVS_TEST_CACHE' in os.environ else tempfile.mkdtemp(prefix='dvs_test_cache_')
os.environ['DVS_CACHE'] = os.environ.setdefault('DVS_TEST_CACHE', str(_OWN_CACHE))
_ENDING = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
# Domains above 101 meet the ephemeral ports of Linux.
_DOMAINS = 101
_TURNS = itertools.count(os.getpid() * 13)

# These take longest, and so they begin first: what comes last is short, and no worker waits.
_LONGEST = (
    'test_every_command_of_a_section_works',
    'test_a_ros_from_apt_is_used_in_a_path_with_a_space_and_an_umlaut',
    'test_all_six_start_orders_give_the_same_bytes',
    'test_a_lockstep_loop_regulates_again_whichever_nodes_were_killed',
    'test_two_loops_run_side_by_side_as_if_alone',
    'test_a_script_runs_small_and_leaves_its_files',
    'test_replayed_events_give_the_recorded_commands',
    'test_scenario_regulates',
)
# Of the files whose tests stay together.
_LONGEST_FILES = (
    'test_random_plants',
    'test_paper',
    'test_backends',
    'test_textbook_plants',
    'test_report',
    'test_units',
    'test_kernel_cache',
    'test_real_sensor',
)
_OF_PROCESSES = {'domain', 'new_domain', 'processes'}
# Imports and collection make hundreds of thousands of objects, and no garbage.
gc.disable()


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Function]) -> None:
    """Put the longest first; a test of processes goes to any worker, others with their file."""
    for item in items:
        if _turn(item) > 0:
            item.add_marker(pytest.mark.xdist_group(item.path.stem))
    items.sort(key=_turn)


def _turn(item: pytest.Function) -> int:
    if item.originalname in _LONGEST:
        return _LONGEST.index(item.originalname) - len(_LONGEST)
    if _OF_PROCESSES.intersection(item.fixturenames):
        return 0
    stem = item.path.stem
    return 1 + (_LONGEST_FILES.index(stem) if stem in _LONGEST_FILES else len(_LONGEST_FILES))


def pytest_unconfigure() -> None:
    """Remove what was kept, where this process has made the folder."""
    if _OWN_CACHE is not None:
        shutil.rmtree(_OWN_CACHE, ignore_errors=True)


def pytest_collection_finish() -> None:
    """Search for garbage from here on, and never again among what is imported and collected."""
    gc.freeze()
    gc.enable()


@pytest.fixture(autouse=True)
def state_of_the_process() -> Iterator[None]:
    """Put back what a test changes of its process, so that no other depends on their order.

    A session of ROS leaves its handlers of signals, a cluster of Dask its environment variables.
    """
    handlers = {number: signal.getsignal(number) for number in _ENDING}
    folder, errors, variables = Path.cwd(), np.geterr(), dict(os.environ)
    yield
    for number, handler in handlers.items():
        signal.signal(number, handler)
    os.chdir(folder)
    np.seterr(**errors)
    changed = {name for name, _ in variables.items() ^ dict(os.environ).items()}
    changed.discard('PYTEST_CURRENT_TEST')
    for name in changed:
        os.environ.pop(name, None)
    os.environ.update({name: variables[name] for name in changed & variables.keys()})


@pytest.fixture(scope='module')
def new_domain() -> Iterator[Callable[[], int]]:
    """Gives out ROS domains in which nobody else on this machine tests."""
    with contextlib.ExitStack() as held:
        yield lambda: _free_domain(held)


@pytest.fixture
def domain(new_domain: Callable[[], int]) -> int:
    """A ROS domain for this test alone."""
    return new_domain()


@pytest.fixture
def another_user() -> list[str]:
    """What begins a command of another user, who reads everything and writes own files only.

    This checkout may lie where other users can't look.
    """
    user = '47110'
    become = ['setpriv', f'--reuid={user}', f'--regid={user}', '--clear-groups']
    become += ['--inh-caps=+dac_read_search', '--ambient-caps=+dac_read_search']
    if os.geteuid() or not shutil.which('setpriv'):
        pytest.skip('only root can be another user')
    if subprocess.run([*become, 'true'], capture_output=True).returncode:
        pytest.skip('needs the right to become another user')
    return become


def _free_domain(held: contextlib.ExitStack) -> int:
    """Domain whose lock file this process holds; the system frees it whatever happens."""
    for turn in itertools.islice(_TURNS, _DOMAINS):
        domain = 1 + turn % _DOMAINS
        path = Path(tempfile.gettempdir()) / f'dvs_test_domain_{domain}.lock'
        # Whoever has made it: only its owner could open it for writing.
        with contextlib.suppress(FileExistsError):
            path.touch(exist_ok=False)
        with contextlib.suppress(BlockingIOError, PermissionError):
            lock = held.enter_context(path.open('rb'))
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            return domain
    raise RuntimeError(f'all {_DOMAINS} ROS domains are in use')
