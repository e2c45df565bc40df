from pathlib import Path
from xml.etree import ElementTree

from setuptools import find_packages, setup

package_name = 'dvs_simulation'
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
    package_data={package_name: ['py.typed', '*.pyi', 'paper/*.j2']},
    data_files=[
        ('share/ament_index/resource_index/packages', [f'resource/{package_name}']),
        (f'share/{package_name}', ['package.xml']),
    ],
    install_requires=[
        beside('dvs_common'),
        beside('dvs_event_camera'),
        beside('dvs_hinf_controller'),
        beside('dvs_plant_sim'),
        'Jinja2>=3.1',
        'numpy>=1.26',
        'scipy>=1.11',
        'tqdm>=4.64',
    ],
    extras_require={
        'numba': ['numba>=0.59'],
        'plot': ['matplotlib>=3.6', 'Pillow>=9.5'],
        'sweep': ['distributed>=2024.1', 'matplotlib>=3.6', 'numba>=0.59'],
        'test': [
            'hypothesis>=6.100',
            'pytest>=8,<9.2',
            'pytest-timeout>=2.3',
            'mpmath>=1.3',
            'PyYAML>=6.0',
        ],
    },
    zip_safe=False,
    maintainer=manifest.findtext('maintainer'),
    maintainer_email=manifest.find('maintainer').get('email'),
    description=manifest.findtext('description'),
    license=manifest.findtext('license'),
    entry_points={
        'console_scripts': [
            'dvs_simulation = dvs_simulation.programs:dvs_simulation',
        ],
    },
)
