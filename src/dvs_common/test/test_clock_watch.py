"""A wall clock that is set back stops no session."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip('rclpy')

pytestmark = pytest.mark.processes

# The longest turn, and how often a timer of 20 ms came, in 2 s with a step of the clock in them.
STEP = """
import os, struct, sys, threading, time
import rclpy
from rclpy.clock import Clock, ClockType
from dvs_common.node.session import ros_session

def set_clock(offset_s):
    with open(os.environ['STEPPED_CLOCK'], 'r+b') as file:
        file.write(struct.pack('@l', offset_s))

with ros_session() as session:
    node = session.add(rclpy.create_node('steps'))
    ticks = []
    node.create_timer(0.02, lambda: ticks.append(1), clock=Clock(clock_type=ClockType.STEADY_TIME))
    for offset_s in (-3600, 0):
        wall, ticks[:] = time.time(), []
        threading.Timer(0.5, set_clock, [offset_s]).start()
        longest, end = 0.0, time.monotonic() + 2.0
        while time.monotonic() < end:
            began = time.monotonic()
            session.turn()
            longest = max(longest, time.monotonic() - began)
        print(round(time.time() - wall), len(ticks), longest)
"""


def test_a_clock_that_is_set_back_by_an_hour_stops_no_timer(domain, tmp_path):
    if not shutil.which('cc'):
        pytest.skip('needs a C compiler')
    library = tmp_path / 'stepped_clock.so'
    source = Path(__file__).with_name('stepped_clock.c')
    subprocess.run(['cc', '-shared', '-fPIC', '-o', library, source, '-ldl'], check=True)
    (tmp_path / 'offset').write_bytes(bytes(8))
    variables = {'LD_PRELOAD': str(library), 'STEPPED_CLOCK': str(tmp_path / 'offset')}
    run = subprocess.run(
        [sys.executable, '-c', STEP],
        env=os.environ | variables | {'ROS_DOMAIN_ID': str(domain)},
        capture_output=True,
        text=True,
        timeout=60,
    )

    assert run.returncode == 0, run.stderr
    back, forth = ([float(word) for word in line.split()] for line in run.stdout.splitlines())
    assert (back[0], forth[0]) == (pytest.approx(-3598, abs=2), pytest.approx(3602, abs=2))
    # A hundred each, less what a busy machine leaves out: 25 come before the step.
    assert min(back[1], forth[1]) > 45
