from glob import glob
from pathlib import Path
from xml.etree import ElementTree

from setuptools import find_packages, setup

package_name = 'dvs_hinf_controller'
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
    package_data={package_name: ['py.typed', '*.pyi']},
    data_files=[
        ('share/ament_index/resource_index/packages', [f'resource/{package_name}']),
        (f'share/{package_name}', ['package.xml']),
        (f'share/{package_name}/launch', glob('launch/*.launch.py')),
    ],
    install_requires=[beside('dvs_common'), 'numpy>=1.26', 'scipy>=1.11'],
    extras_require={
        'control': ['control>=0.10'],
        'numba': ['numba>=0.59'],
        'plot': ['matplotlib>=3.6'],
        'ros': ['ros-jazzy-rclpy[fastrtps]==7.1.6', 'ros-jazzy-common-interfaces==5.3.6'],
        'test': [
            'hypothesis>=6.100',
            'pytest>=8,<9.2',
            'pytest-timeout>=2.3',
            'mpmath>=1.3',
            'slycot>=0.6',
        ],
    },
    zip_safe=False,
    maintainer=manifest.findtext('maintainer'),
    maintainer_email=manifest.find('maintainer').get('email'),
    description=manifest.findtext('description'),
    license=manifest.findtext('license'),
    entry_points={
        'console_scripts': [
            'design_controller = dvs_hinf_controller.programs:design_controller',
            'hinf_controller = dvs_hinf_controller.programs:hinf_controller',
        ],
    },
)
