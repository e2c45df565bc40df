#!/usr/bin/env python3
"""Makes docs/figures/dashboard.png: the live page of the scenario mirror_r3 in headless Chromium.

Needs the workspace (scripts/setup.sh --test), chromium and chromedriver. Run it as
    source install/setup.bash && scripts/dashboard_screenshot.py
"""

from __future__ import annotations

import os
import signal
import subprocess
import tempfile
import time
from pathlib import Path

try:
    from selenium import webdriver
    from selenium.webdriver.chrome.service import Service
except ImportError:
    raise SystemExit('selenium is missing: run scripts/setup.sh --test') from None

ROOT = Path(__file__).resolve().parents[1]
TARGET = ROOT / 'docs' / 'figures' / 'dashboard.png'
SHOWN_SECONDS = 4.0
FLAGS = (
    '--headless',
    '--no-sandbox',
    '--disable-gpu',
    '--disable-quic',
    '--no-first-run',
    '--disable-background-networking',
    '--disable-component-update',
    '--disable-sync',
    '--hide-scrollbars',
    '--window-size=1400,1180',
)


def start(package: str, executable: str, *arguments: str) -> subprocess.Popen[str]:
    """Start an installed executable, as `ros2 run` does."""
    program = ROOT / 'install' / package / 'lib' / package / executable
    return subprocess.Popen([str(program), *arguments], stdout=subprocess.PIPE, text=True)


def photograph(url: str) -> None:
    """Wait until the page shows the run and take its picture."""
    options = webdriver.ChromeOptions()
    for flag in (*FLAGS, f'--user-data-dir={tempfile.mkdtemp()}'):
        options.add_argument(flag)
    browser = webdriver.Chrome(options=options, service=Service('/usr/bin/chromedriver'))
    try:
        browser.get(url)
        browser.execute_script("document.getElementById('window').value = '5'")
        deadline = time.monotonic() + 120
        while time.monotonic() < deadline:
            shown = browser.find_element('id', 'value-time').text
            if shown not in ('', '–') and float(shown) >= SHOWN_SECONDS:
                break
            time.sleep(0.1)
        TARGET.parent.mkdir(parents=True, exist_ok=True)
        browser.save_screenshot(str(TARGET))
    finally:
        browser.quit()


def main() -> None:
    """Run loop, page and browser."""
    os.environ.setdefault('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    os.environ.setdefault('ROS_DOMAIN_ID', '77')
    processes = [start('dvs_closed_loop', 'dvs_closed_loop', 'dashboard', '--port', '0')]
    try:
        assert processes[0].stdout is not None
        url = processes[0].stdout.readline().split()[1]
        slow = ('--ros-args', '-p', 'real_time_factor:=0.5', '-p', 'duration:=60.0')
        processes.append(start('dvs_event_camera', 'event_camera', *slow))
        processes.append(start('dvs_hinf_controller', 'hinf_controller', *slow))
        # The plant comes last, so that the page receives the run from its beginning.
        time.sleep(4)
        processes.append(start('dvs_plant_sim', 'plant_sim', *slow))
        photograph(url)
    finally:
        for process in processes:
            process.send_signal(signal.SIGINT)
        for process in processes:
            process.wait(timeout=20)


if __name__ == '__main__':
    main()
