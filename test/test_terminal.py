"""What people see at a terminal while they wait; in a pipe it is left out."""

import fcntl
import os
import pty
import re
import signal
import struct
import subprocess
import termios
import threading

import pytest
from loop_support import (
    CONFIG,
    UNHURRIED,
    environment,
    program,
    ros_arguments,
    scenario_file,
    start,
    wait_for,
)

SCENARIO = str(CONFIG / 'mirror_r3.yaml')


class Terminal:
    """A program whose standard error is a terminal of 30 lines of 120 characters."""

    def __init__(self, command, domain):
        screen, keyboard = pty.openpty()
        fcntl.ioctl(keyboard, termios.TIOCSWINSZ, struct.pack('HHHH', 30, 120, 0, 0))
        self.process = subprocess.Popen(
            command,
            env=environment(domain),
            stdin=subprocess.DEVNULL,
            stdout=keyboard,
            stderr=keyboard,
        )
        os.close(keyboard)
        self.text = ''
        self._reader = threading.Thread(target=self._read, args=(screen,))
        self._reader.start()

    def _read(self, screen):
        # Reading a terminal that is no longer written to is an error.
        try:
            while part := os.read(screen, 65536):
                self.text += part.decode()
        except OSError:
            os.close(screen)

    def interrupt(self):
        self.process.send_signal(signal.SIGINT)
        code = self.process.wait(timeout=30)
        self._reader.join(timeout=30)
        return code


def simulated_s(text):
    """Time that the progress of a loop has shown last."""
    shown = re.findall(r'(\d+\.\d\d)(?:/1000\.00)? s, \d+ cycles/s', text)
    return float(shown[-1]) if shown else 0.0


@pytest.mark.parametrize('duration', ['0', '1000'])
def test_a_loop_shows_what_it_waits_for_and_how_far_it_is(duration, domain, processes, tmp_path):
    slow = str(scenario_file(tmp_path / 'slow.yaml', **UNHURRIED))
    options = ['--params-file', slow, '--duration', duration, '--output', str(tmp_path)]
    terminal = Terminal([program('closed_loop'), *options], domain)
    processes.append(terminal.process)

    # Settled, however slowly it runs on a busy machine.
    assert wait_for(lambda: simulated_s(terminal.text) > 0.5, 60), terminal.text
    code = terminal.interrupt()

    assert code == 0, terminal.text
    assert 'waiting for plant_sim to answer' in terminal.text
    assert 'cycles/s, ' in terminal.text and 'x real time' in terminal.text
    assert ('1000.00 s' in terminal.text) == (duration == '1000')
    assert 'regulated' in terminal.text
    assert 'Traceback' not in terminal.text


def test_a_recorder_shows_messages_and_size(domain, processes, tmp_path):
    terminal = Terminal(
        [program('dvs_closed_loop'), 'record', str(tmp_path / 'bag'), '--params-file', SCENARIO],
        domain,
    )
    processes.append(terminal.process)
    assert wait_for(lambda: 'recording 10 topics' in terminal.text, 30), terminal.text
    for node in ('event_camera', 'hinf_controller', 'plant_sim'):
        processes.append(start(node, domain, ros_arguments(UNHURRIED)))

    moving = re.compile(r'recording: [1-9]\d* messages .* events/s, ')
    assert wait_for(
        lambda: moving.search(terminal.text) and 'receives luminosity' in terminal.text, 60
    ), terminal.text
    code = terminal.interrupt()

    assert code == 0, terminal.text
    assert ' MB' in terminal.text and 'LOST' not in terminal.text
    assert 'no event lost' in terminal.text
    assert 'Traceback' not in terminal.text
