"""A loop started with a file keyed by names of nodes: they get its values, or it is refused."""

import json

from loop_support import run_closed_loop

BY_NAME = """
{prefix}plant_sim:
  ros__parameters: {{duration: 0.2, set_point: [0.1, -0.04], set_point_tolerance: 0.01}}
{prefix}event_camera:
  ros__parameters: {{event_threshold: 0.05}}
{prefix}hinf_controller:
  ros__parameters: {{event_threshold: 0.05, set_point: [0.1, -0.04], set_point_tolerance: 0.01}}
"""


def written(path, prefix):
    path.write_text(BY_NAME.format(prefix=prefix))
    return path


def test_a_loop_runs_with_the_values_of_a_file_keyed_by_full_names(domain, tmp_path):
    file = written(tmp_path / 'robot.yaml', '/left/')

    run = run_closed_loop(file, domain, tmp_path, '--namespace', 'left')

    result = json.loads((tmp_path / 'left' / 'robot' / 'result.json').read_text())
    assert result['simulated_seconds'] == 0.2, run.stderr
    assert result['h'] == 0.05
    # Nodes that ran with other values than those they are judged by would exceed it.
    assert 0 < result['sector_ratio_max'] <= 1


def test_a_file_keyed_by_the_names_of_another_namespace_is_refused(domain, tmp_path):
    file = written(tmp_path / 'robot.yaml', '')

    run = run_closed_loop(file, domain, tmp_path, '--namespace', 'left')

    assert run.returncode == 2
    assert 'plant_sim, which is no node of this loop: they are /left/plant_sim' in run.stderr
    assert not (tmp_path / 'left').exists()


def test_the_controller_may_believe_what_is_not_so(domain, tmp_path):
    file = tmp_path / 'apart.yaml'
    file.write_text(
        '/**: {ros__parameters: {duration: 0.2}}\n'
        '/**/hinf_controller: {ros__parameters: {initial_state: [0.9, 0.4]}}\n'
    )

    run = run_closed_loop(file, domain, tmp_path)

    result = json.loads((tmp_path / 'apart' / 'result.json').read_text())
    assert result['sector_ratio_max'] > 1, run.stderr
