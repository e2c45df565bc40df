from glob import glob

from setuptools import find_packages, setup

package_name = 'dvs_closed_loop'

setup(
    name=package_name,
    version='0.1.0',
    packages=find_packages(exclude=['test']),
    package_data={package_name: ['py.typed', 'dashboard/web/*']},
    data_files=[
        ('share/ament_index/resource_index/packages', [f'resource/{package_name}']),
        (f'share/{package_name}', ['package.xml']),
        (f'share/{package_name}/layouts', glob('layouts/*')),
        (f'share/{package_name}/launch', glob('launch/*.launch.py')),
        (f'share/{package_name}/config', glob('config/*.yaml')),
    ],
    install_requires=['setuptools'],
    zip_safe=False,
    maintainer='DVS regulation developers',
    maintainer_email='maintainers@example.org',
    description='The whole loop: runner, recorder, reports and dashboard.',
    license='Apache-2.0',
    entry_points={
        'console_scripts': [
            'dvs_closed_loop = dvs_closed_loop.cli:main',
            'closed_loop = dvs_closed_loop.running.closed_loop:main',
            'composed_loop = dvs_closed_loop.running.composed_loop:main',
        ],
    },
)
