"""Recordings of any size are shown and converted in bounded memory."""

import json
import subprocess
import sys

import pytest
from sensor_encoders import large_dat_file

# Prints the peak of the process, MB, after what the tool printed.
MEASURED = """
import resource, sys
from dvs_event_camera.tools import {tool} as tool
code = tool.main({arguments!r})
print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024)
sys.exit(code)
"""


def peak_of(tool, *arguments):
    program = MEASURED.format(tool=tool, arguments=list(arguments))
    run = subprocess.run([sys.executable, '-c', program], capture_output=True, text=True)
    assert run.returncode == 0, run.stderr
    *printed, peak = run.stdout.splitlines()
    return float(peak), printed[-1]


def show(path):
    return peak_of('show_events', 'show_events', str(path), '--json')


def convert(path, target):
    return peak_of('convert_events', str(path), str(target))


@pytest.mark.processes
def test_memory_does_not_grow_with_the_recording(tmp_path):
    small, large = (
        large_dat_file(tmp_path / f'{name}.dat', size)
        for name, size in (('small', 1), ('large', 6))
    )
    # All events of the large one in memory would be 65 MB more.
    assert show(large)[0] - show(small)[0] < 30
    peaks = [convert(path, tmp_path / f'{path.stem}.h5')[0] for path in (small, large)]
    assert peaks[1] - peaks[0] < 30
    described = [json.loads(show(path)[1]) for path in (large, tmp_path / 'large.h5')]
    assert described[0]['events'] == 6 * 10**6
    assert described[0]['sha256'] == described[1]['sha256']


@pytest.mark.long
@pytest.mark.parametrize('suffix', ['npy', 'npz', 'h5', 'aedat4', 'csv', 'txt'])
def test_a_hundred_million_events_in_half_a_gigabyte(suffix, tmp_path):
    path = large_dat_file(tmp_path / 'large.dat', 100)
    target = tmp_path / f'large.{suffix}'

    peaks = [show(path)[0], convert(path, target)[0], show(target)[0]]

    assert max(peaks) < 500
