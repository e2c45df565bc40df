"""Write the SROS2 policy of the loop: exactly the topics and services that each node uses.

The three nodes are started as they are, their endpoints are read from the live graph, and
config/security/policy.xml is written from it. ``--check`` compares and changes nothing.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from xml.etree import ElementTree

import rclpy
from ament_index_python.packages import get_package_prefix
from rclpy.node import Node

ROOT = Path(__file__).resolve().parents[1]
POLICY = ROOT / 'config' / 'security' / 'policy.xml'
PROGRAMS = {
    'plant_sim': 'dvs_plant_sim',
    'event_camera': 'dvs_event_camera',
    'hinf_controller': 'dvs_hinf_controller',
}
_START_S = 60.0
# Endpoints that come with activation are there this long after the last change.
_QUIET_S = 2.0
_TURN_S = 0.1
_HEAD = """<?xml version="1.0" encoding="UTF-8"?>
<!-- Made by scripts/security_policy.py from the live graph; see docs/security.md. -->
"""

# Kind of endpoint, as the policy names it, and the question to the graph.
_KINDS: dict[tuple[str, str], Callable[[Node, str, str], list[tuple[str, list[str]]]]] = {
    ('topics', 'publish'): Node.get_publisher_names_and_types_by_node,
    ('topics', 'subscribe'): Node.get_subscriber_names_and_types_by_node,
    ('services', 'reply'): Node.get_service_names_and_types_by_node,
    ('services', 'request'): Node.get_client_names_and_types_by_node,
}


def main() -> int:
    """Write the policy, or compare it with ``--check``; return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--check', action='store_true', help='compare, change nothing')
    options = parser.parse_args()
    text = policy(live_endpoints())
    if not options.check:
        POLICY.parent.mkdir(parents=True, exist_ok=True)
        POLICY.write_text(text, encoding='utf-8')
        return 0
    if POLICY.read_text(encoding='utf-8') == text:
        return 0
    print(f'{POLICY.relative_to(ROOT)} is not what the nodes use:\n{text}', file=sys.stderr)
    return 1


def live_endpoints() -> dict[str, dict[tuple[str, str], tuple[str, ...]]]:
    """Endpoints of every node by kind, read from a running loop.

    Raises
    ------
    TimeoutError
        If the nodes do not come up.
    """
    with _running_nodes(), _observer() as observer:
        deadline = time.monotonic() + _START_S
        seen: dict[str, dict[tuple[str, str], tuple[str, ...]]] = {}
        unchanged_since = time.monotonic()
        while time.monotonic() < deadline:
            now = {name: _endpoints(observer, name) for name in PROGRAMS}
            if now != seen:
                seen, unchanged_since = now, time.monotonic()
            complete = all(seen.values())
            if complete and time.monotonic() - unchanged_since > _QUIET_S:
                return seen
            time.sleep(_TURN_S)
    raise TimeoutError(f'the nodes did not come up within {_START_S:g} s')


def policy(nodes: dict[str, dict[tuple[str, str], tuple[str, ...]]]) -> str:
    """Policy file for the given endpoints.

    Parameters
    ----------
    nodes
        Endpoints of every node by kind.
    """
    root = ElementTree.Element('policy', version='0.2.0')
    enclaves = ElementTree.SubElement(root, 'enclaves')
    for name, endpoints in nodes.items():
        enclave = ElementTree.SubElement(enclaves, 'enclave', path=f'/{name}')
        profiles = ElementTree.SubElement(enclave, 'profiles')
        profile = ElementTree.SubElement(profiles, 'profile', node=name, ns='/')
        for (kind, access), names in endpoints.items():
            if names:
                group = ElementTree.SubElement(profile, kind, {access: 'ALLOW'})
                for endpoint in names:
                    ElementTree.SubElement(group, kind.removesuffix('s')).text = endpoint
    ElementTree.indent(root)
    return _HEAD + ElementTree.tostring(root, encoding='unicode') + '\n'


def _endpoints(observer: Node, name: str) -> dict[tuple[str, str], tuple[str, ...]]:
    try:
        return {
            kind: tuple(sorted(_named(endpoint, name) for endpoint, _ in ask(observer, name, '/')))
            for kind, ask in _KINDS.items()
        }
    except RuntimeError:  # the node is not there yet
        return {}


def _named(endpoint: str, node: str) -> str:
    """Name as the policy has it: relative to the node's namespace, or private."""
    private = f'/{node}/'
    if endpoint.startswith(private):
        return '~/' + endpoint.removeprefix(private)
    return endpoint.removeprefix('/') if endpoint.count('/') == 1 else endpoint


@contextmanager
def _running_nodes() -> Iterator[None]:
    arguments = ['--ros-args', '--params-file', str(ROOT / 'config' / 'mirror_r3.yaml')]
    arguments += ['-p', 'duration:=0.0', '-p', 'real_time_factor:=1.0']
    processes = [
        subprocess.Popen(
            [f'{get_package_prefix(package)}/lib/{package}/{name}', *arguments],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            env={**os.environ, 'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST'},
        )
        for name, package in PROGRAMS.items()
    ]
    try:
        yield
    finally:
        for process in processes:
            process.terminate()
        for process in processes:
            process.wait()


@contextmanager
def _observer() -> Iterator[Node]:
    rclpy.init(args=[])
    try:
        yield rclpy.create_node('security_policy')
    finally:
        rclpy.try_shutdown()


if __name__ == '__main__':
    sys.exit(main())
