from glob import glob

from setuptools import find_packages, setup

package_name = 'dvs_plant_sim'

setup(
    name=package_name,
    version='0.1.0',
    packages=find_packages(exclude=['test']),
    package_data={package_name: ['py.typed']},
    data_files=[
        ('share/ament_index/resource_index/packages', [f'resource/{package_name}']),
        (f'share/{package_name}', ['package.xml']),
        (f'share/{package_name}/launch', glob('launch/*.launch.py')),
    ],
    install_requires=['setuptools'],
    zip_safe=False,
    maintainer='DVS regulation developers',
    maintainer_email='maintainers@example.org',
    description='Exact simulation of a linear plant seen by an array of pixels, as a ROS 2 node.',
    license='Apache-2.0',
    entry_points={
        'console_scripts': [
            'plant_sim = dvs_plant_sim.plant_sim_node:main',
            'pendulum_sim = dvs_plant_sim.pendulum_sim_node:main',
        ],
    },
)
