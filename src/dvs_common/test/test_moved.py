import subprocess
import sys
import warnings
from importlib import import_module

import pytest

from dvs_common.moved import MOVED


def test_every_new_name_is_a_module():
    ros = [new for new in MOVED.values() if new.endswith(('launching', 'composed_loop'))]
    for new in sorted(set(MOVED.values()) - set(ros)):
        assert import_module(new).__name__ == new


@pytest.mark.processes
@pytest.mark.parametrize(
    ('old', 'name'),
    [
        ('dvs_interfaces.scenario', 'load_scenario'),
        ('dvs_interfaces.messages', 'pack_image'),
        ('dvs_event_camera.pixel_array', 'PixelArray'),
        ('dvs_closed_loop.sampled_loop', 'run_sampled'),
        ('dvs_hinf_controller.reduced', 'reduced_plant'),
    ],
)
def test_an_old_name_is_the_new_module_with_a_warning(old, name):
    program = (
        f'import warnings; warnings.simplefilter("always"); import {old} as old; '
        f'import {MOVED[old]} as new; assert old is new; print(new.__spec__.name)'
    )
    run = subprocess.run([sys.executable, '-c', program], capture_output=True, text=True)

    assert run.stdout.strip() == MOVED[old], run.stderr
    assert f'DeprecationWarning: {old} is now {MOVED[old]}' in run.stderr
    assert hasattr(import_module(MOVED[old]), name)


def test_a_new_name_warns_of_nothing():
    with warnings.catch_warnings():
        warnings.simplefilter('error')
        import_module('dvs_common.wire.messages')


def test_a_module_that_never_was_is_not_found():
    with pytest.raises(ModuleNotFoundError, match=r'dvs_interfaces\.nothing'):
        import_module('dvs_interfaces.nothing')
