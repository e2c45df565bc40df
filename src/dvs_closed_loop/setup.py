from glob import glob
from pathlib import Path
from xml.etree import ElementTree

from setuptools import find_packages, setup

package_name = 'dvs_closed_loop'
manifest = ElementTree.parse('package.xml')


def beside(name):
    """Requirement of a package in the folder beside this one, where it is; no index has it."""
    folder = Path.cwd().parent / name
    # colcon refuses a URL without a host.
    url = folder.as_uri().replace('file://', 'file://localhost', 1)
    return f'{name} @ {url}' if (folder / 'setup.py').is_file() else name


setup(
    name=package_name,
    version=manifest.findtext('version'),
    packages=find_packages(exclude=['test']),
    package_data={
        package_name: [
            'py.typed',
            '*.pyi',
            'bags/*.json',
            'dashboard/*.j2',
            'dashboard/web/*',
            'reports/*.j2',
        ]
    },
    data_files=[
        ('share/ament_index/resource_index/packages', [f'resource/{package_name}']),
        (f'share/{package_name}', ['package.xml']),
        (f'share/{package_name}/layouts', glob('layouts/*')),
        (f'share/{package_name}/launch', glob('launch/*.launch.py')),
        (f'share/{package_name}/config', [*glob('config/*.yaml'), *glob('config/*.png')]),
        (f'share/{package_name}/config/qos', glob('config/qos/*.yaml')),
    ],
    install_requires=[
        'aiohttp>=3.9',
        beside('dvs_common'),
        beside('dvs_event_camera'),
        beside('dvs_hinf_controller'),
        beside('dvs_plant_sim'),
        beside('dvs_simulation'),
        'matplotlib>=3.6',
        'numpy>=1.26',
        'PyYAML>=6.0',
        'mcap>=1.6',
        'rosbags>=0.11',
        'tqdm>=4.64',
    ],
    extras_require={
        'ros': ['ros-jazzy-rclpy[fastrtps]==7.1.6', 'ros-jazzy-common-interfaces==5.3.6'],
        'test': ['hypothesis>=6.100', 'pytest>=8,<9.2', 'pytest-timeout>=2.3'],
    },
    zip_safe=False,
    maintainer=manifest.findtext('maintainer'),
    maintainer_email=manifest.find('maintainer').get('email'),
    description=manifest.findtext('description'),
    license=manifest.findtext('license'),
    entry_points={
        'console_scripts': [
            'dvs_closed_loop = dvs_closed_loop.programs:dvs_closed_loop',
            'closed_loop = dvs_closed_loop.programs:closed_loop',
            'composed_loop = dvs_closed_loop.programs:composed_loop',
        ],
    },
)
