from xml.etree import ElementTree

from setuptools import find_packages, setup

package_name = 'dvs_common'
manifest = ElementTree.parse('package.xml')

setup(
    name=package_name,
    version=manifest.findtext('version'),
    packages=find_packages(exclude=['test']),
    package_data={package_name: ['py.typed', '*.pyi', 'node/*.xml']},
    data_files=[
        ('share/ament_index/resource_index/packages', [f'resource/{package_name}']),
        (f'share/{package_name}', ['package.xml']),
    ],
    install_requires=['numpy>=1.26', 'PyYAML>=6.0'],
    extras_require={
        'numba': ['numba>=0.59'],
        'pictures': ['Pillow>=9.5'],
        'plot': ['matplotlib>=3.6'],
        'ros': ['ros-jazzy-rclpy[fastrtps]==7.1.6', 'ros-jazzy-common-interfaces==5.3.6'],
        'test': ['hypothesis>=6.100', 'pytest>=8,<9.2', 'pytest-timeout>=2.3'],
    },
    zip_safe=False,
    maintainer=manifest.findtext('maintainer'),
    maintainer_email=manifest.find('maintainer').get('email'),
    description=manifest.findtext('description'),
    license=manifest.findtext('license'),
    entry_points={
        'console_scripts': [],
    },
)
