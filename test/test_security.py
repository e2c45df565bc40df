"""The security policy allows exactly what the running nodes use."""

import subprocess
import sys
from xml.etree import ElementTree

from loop_support import ROOT, environment

POLICY = ROOT / 'config' / 'security' / 'policy.xml'


def test_the_policy_is_the_live_graph(domain):
    script = ROOT / 'scripts' / 'security_policy.py'
    check = subprocess.run(
        [sys.executable, script, '--check'],
        env=environment(domain),
        capture_output=True,
        text=True,
        timeout=120,
    )

    assert check.returncode == 0, check.stderr


def test_the_policy_lets_no_node_write_what_another_answers_for():
    writers = {}
    for enclave in ElementTree.parse(POLICY).iter('enclave'):
        for group in enclave.iter('topics'):
            if group.get('publish'):
                for topic in group:
                    writers.setdefault(topic.text, []).append(enclave.get('path'))

    shared = {topic for topic, names in writers.items() if len(names) > 1}
    assert shared == {'diagnostics', 'parameter_events', 'rosout', '~/transition_event'}
    assert writers['command'] == ['/hinf_controller']
    assert writers['luminosity'] == ['/plant_sim']
