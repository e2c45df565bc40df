"""The page's server answers its own names only, and sends frames to every page."""

import json
import re
import socket
import urllib.error
import urllib.request

import pytest

from dvs_closed_loop.dashboard.dashboard_server import DashboardServer, is_expected_host
from dvs_common.errors import ParameterError


@pytest.fixture
def server():
    server = DashboardServer('127.0.0.1', 0)
    yield server
    server.close()


def fetch(server, path='/', **headers):
    request = urllib.request.Request(f'http://127.0.0.1:{server.port}{path}', headers=headers)
    return urllib.request.urlopen(request, timeout=20)


def read_events(response, count):
    events = []
    while len(events) < count:
        line = response.readline().decode().strip()
        if line.startswith('data: '):
            events.append(json.loads(line[6:]))
    return events


@pytest.mark.parametrize('path', ['/', '/dashboard.js', '/dashboard.css', '/icon.svg'])
def test_a_file_is_served_with_a_strict_policy(path, server):
    with fetch(server, path) as response:
        assert response.read()
        assert "default-src 'none'" in response.headers['Content-Security-Policy']
        assert response.headers['X-Content-Type-Options'] == 'nosniff'


def test_the_page_has_every_element_that_its_script_asks_for(server):
    html, script = (fetch(server, path).read().decode() for path in ('/', '/dashboard.js'))
    present = re.findall(r'\bid="([\w-]+)"', html)

    assert len(set(present)) == len(present)
    assert set(re.findall(r"byId\('([\w-]+)'\)", script)) <= set(present)
    assert '{{' not in html
    assert '{%' not in html


def test_frames_reach_every_page_and_late_ones_get_the_past(server):
    server.publish({'state': [[0.0, 1.0]], 'n': 1})
    with fetch(server, '/stream') as early:
        assert read_events(early, 1) == [[{'state': [[0.0, 1.0]], 'n': 1}]]
        server.publish({'state': [[0.1, 1.0]], 'n': 2})
        assert read_events(early, 1)[0]['n'] == 2
        with fetch(server, '/stream') as late:
            assert [frame['n'] for frame in read_events(late, 1)[0]] == [1, 2]
    server.publish({'state': [[0.0, 1.0]], 'restart': True, 'n': 3})
    with fetch(server, '/stream') as latest:
        assert [frame['n'] for frame in read_events(latest, 1)[0]] == [3]


@pytest.mark.parametrize('path', ['/', '/stream'])
def test_a_foreign_host_header_is_refused(path, server):
    with pytest.raises(urllib.error.HTTPError, match='421'):
        fetch(server, path, Host='evil.example')


def test_a_page_of_another_site_is_refused(server):
    with pytest.raises(urllib.error.HTTPError, match='403'):
        fetch(server, '/stream', Origin='http://evil.example')
    with fetch(server, '/', Origin=f'http://localhost:{server.port}') as response:
        assert response.status == 200


@pytest.mark.parametrize(
    ('host', 'listening', 'expected'),
    [
        ('localhost:80', '127.0.0.1', True),
        ('127.0.0.1', '127.0.0.1', True),
        ('[::1]:8765', '::1', True),
        ('LOCALHOST', '127.0.0.1', True),
        ('10.1.2.3:8765', '127.0.0.1', False),
        ('10.1.2.3:8765', '0.0.0.0', True),
        ('robot.example:8765', '0.0.0.0', False),
        ('robot.example:8765', 'robot.example', True),
        ('localhost.evil.example', '127.0.0.1', False),
        ('127.0.0.1.evil.example', '127.0.0.1', False),
        ('', '127.0.0.1', False),
    ],
)
def test_which_hosts_are_expected(host, listening, expected):
    assert is_expected_host(host, listening) is expected


def test_only_this_machine_can_reach_it(server):
    address = socket.gethostbyname(socket.gethostname())
    if address.startswith('127.'):
        pytest.skip('this machine has no other address')
    with pytest.raises(OSError):
        socket.create_connection((address, server.port), timeout=5)


def test_a_taken_port_is_one_clear_message(server):
    with pytest.raises(ParameterError, match=r"can't listen on 127\.0\.0\.1"):
        DashboardServer('127.0.0.1', server.port)
