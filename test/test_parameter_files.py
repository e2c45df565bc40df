"""A loop started with a file keyed by names of nodes: they get its values, or it is refused."""

import json

from loop_support import listening, ros_arguments, run_closed_loop, start, stop

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

    assert 'results' in run.stdout, run.stderr
    result = json.loads((tmp_path / 'left' / 'robot' / 'result.json').read_text())
    assert result['simulated_seconds'] == 0.2
    assert result['h'] == 0.05
    # Nodes that ran with other values than those they are judged by would exceed it.
    assert 0 < result['sector_ratio_max'] <= 1


def test_a_file_keyed_by_the_names_of_another_namespace_is_refused(domain, tmp_path):
    file = written(tmp_path / 'robot.yaml', '')

    run = run_closed_loop(file, domain, tmp_path, '--namespace', 'left')

    assert run.returncode == 2
    assert 'plant_sim, which is no node of this loop: they are /left/plant_sim' in run.stderr
    assert not (tmp_path / 'left').exists()


def test_a_run_is_judged_by_the_values_of_the_plant_where_the_controller_has_others(
    domain, tmp_path
):
    file = tmp_path / 'apart.yaml'
    file.write_text(
        '/**: {ros__parameters: {duration: 0.6}}\n'
        '/**/hinf_controller: {ros__parameters: {set_point: [0.3, -0.12]}}\n'
    )

    run = run_closed_loop(file, domain, tmp_path)

    assert 'results' in run.stdout, run.stderr
    result = json.loads((tmp_path / 'apart' / 'result.json').read_text())
    assert not result['regulated']
    # The distance of the two set-points is 0.073.
    assert 0.04 < result['final_error'] < 0.11


def test_a_node_that_gets_nothing_from_its_file_warns_of_it(domain, processes, tmp_path):
    file = written(tmp_path / 'robot.yaml', '/left/')
    arguments = ros_arguments(file=file)
    here = start('event_camera', domain, [*arguments, '-r', '__ns:=/right'])
    there = start('event_camera', domain, [*arguments, '-r', '__ns:=/left'])
    processes += [here, there]
    with listening(domain) as listener:
        for namespace in ('/right', '/left'):
            assert listener.spin_until(
                lambda namespace=namespace: (
                    ('event_camera', namespace) in listener.node.get_node_names_and_namespaces()
                )
            )

    assert f'{file} has nothing for /right/event_camera; it has values for' in stop(here)[1]
    assert 'has nothing for' not in stop(there)[1]
