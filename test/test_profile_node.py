"""A plant node before a brightness profile: what it does where the profile ends."""

from diagnostic_msgs.msg import DiagnosticArray
from loop_support import operating, ros_arguments, start, stop
from test_health import latest, values


def test_a_plant_beyond_its_profile_logs_it_and_goes_on(domain, processes, tmp_path):
    wall = tmp_path / 'wall.csv'
    wall.write_text('0.1,0.1\n0.4,0.4\n')
    arguments = ros_arguments({'brightness_profile': str(wall)})
    with operating(domain) as operator:
        messages = operator.collect(DiagnosticArray, '/diagnostics', 100)
        processes.append(start('plant_sim', domain, arguments))

        def beyond():
            status = latest(messages, 'plant_sim')
            return status and int(values(status)['samples beyond the brightness profile'])

        assert operator.spin_until(lambda: beyond() == 1)
        assert 'brightness profile left' in latest(messages, 'plant_sim').message
    code, output = stop(processes[-1])
    assert code == 0
    assert output.count('a pixel is beyond brightness_profile at 0.000000 s') == 1
