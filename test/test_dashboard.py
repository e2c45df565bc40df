"""The live page in a real browser on a running loop: it draws, its values move, no error."""

import importlib.util
import shutil
import urllib.request
from functools import partial

import loop_support
import pytest
from loop_support import UNHURRIED, ros_arguments, start, stop

# A question to the browser takes it as long as a picture.
wait_for = partial(loop_support.wait_for, pause_s=0.1)

FLAGS = (
    '--headless',
    '--no-sandbox',
    '--disable-gpu',
    '--disable-quic',
    '--no-first-run',
    '--disable-background-networking',
    '--disable-component-update',
    '--disable-sync',
    '--window-size=1400,1000',
)
# How many pixels of a canvas are not empty.
INK = """
const c = document.getElementById(arguments[0]);
const d = c.getContext('2d').getImageData(0, 0, c.width, c.height).data;
let n = 0;
for (let i = 3; i < d.length; i += 4) n += d[i] > 0;
return n;
"""
CANVASES = ('error', 'phase', 'events', 'estimate', 'command')


@pytest.fixture
def browser(tmp_path):
    if importlib.util.find_spec('selenium') is None:
        pytest.skip('selenium is not installed')
    from selenium import webdriver
    from selenium.webdriver.chrome.service import Service

    chromium = shutil.which('chromium') or shutil.which('google-chrome')
    driver = shutil.which('chromedriver')
    if not chromium or not driver:
        pytest.skip('no Chromium here: apt-get install chromium chromium-driver')
    options = webdriver.ChromeOptions()
    options.binary_location = chromium
    for flag in (*FLAGS, f'--user-data-dir={tmp_path / "browser"}'):
        options.add_argument(flag)
    options.set_capability('goog:loggingPrefs', {'browser': 'ALL'})
    opened = webdriver.Chrome(options=options, service=Service(driver))
    yield opened
    opened.quit()


def text_of(browser, name):
    return browser.find_element('id', name).text


def number_of(browser, name):
    text = text_of(browser, name).replace(',', '')
    return float(text) if text not in ('', '–') else None


def start_dashboard(domain, processes):
    process = start('dvs_closed_loop', domain, ['dashboard', '--port', '0'])
    processes.append(process)
    return process, process.stdout.readline().split()[1]


def test_the_page_of_a_running_loop(browser, domain, processes):
    dashboard, url = start_dashboard(domain, processes)
    for node in ('event_camera', 'hinf_controller', 'plant_sim'):
        processes.append(start(node, domain, ros_arguments(UNHURRIED)))

    browser.get(url)

    known = ('value-time', 'value-error', 'value-ratio', 'value-events')
    assert wait_for(lambda: all(number_of(browser, name) is not None for name in known), 60)
    assert wait_for(lambda: number_of(browser, 'value-events') > 0)
    before = {name: number_of(browser, name) for name in ('value-time', 'value-events')}
    assert wait_for(lambda: number_of(browser, 'value-time') > before['value-time'] + 0.2)
    assert wait_for(lambda: number_of(browser, 'value-events') > before['value-events'])
    assert text_of(browser, 'status') == 'live'
    assert 'ε = 0.05' in text_of(browser, 'value-tolerance')
    assert '3 pixels' in text_of(browser, 'subtitle')
    assert number_of(browser, 'value-ratio') <= 1
    assert number_of(browser, 'value-lost') == 0
    # h = 0.15 is more than the design guarantees.
    assert wait_for(
        lambda: 'not certified: h ln b + max w' in text_of(browser, 'note-certificate')
    )
    assert wait_for(lambda: number_of(browser, 'value-error') < 0.05)
    for canvas in CANVASES:
        assert browser.execute_script(INK, canvas) > 1000, canvas
    assert browser.get_log('browser') == []

    for node in processes[1:]:
        stop(node)
    assert_an_ended_loop_is_not_called_live(browser)

    code, output = stop(dashboard)
    assert code == 0, output
    assert 'Traceback' not in output
    assert wait_for(lambda: text_of(browser, 'status') == 'connection lost')


def assert_an_ended_loop_is_not_called_live(browser):
    assert wait_for(lambda: text_of(browser, 'status') == 'loop is silent')
    browser.refresh()
    seen = []

    def is_silent():
        seen.append(text_of(browser, 'status'))
        return seen[-1] == 'loop is silent'

    assert wait_for(is_silent), seen
    assert 'live' not in seen
    assert number_of(browser, 'value-error') < 0.05


def test_the_page_without_a_loop_shows_that_it_waits(browser, domain, processes):
    dashboard, url = start_dashboard(domain, processes)

    browser.get(url)

    assert wait_for(lambda: text_of(browser, 'status') == 'no loop received')
    assert browser.get_log('browser') == []
    code, output = stop(dashboard)
    assert code == 0, output


def test_the_dashboard_ends_on_ctrl_c_while_a_page_is_open(domain, processes):
    dashboard, url = start_dashboard(domain, processes)
    with urllib.request.urlopen(f'{url}stream', timeout=20) as page:
        assert page.readline().startswith(b'event: past')
        code, output = stop(dashboard)

    assert code == 0, output
    assert 'Traceback' not in output
