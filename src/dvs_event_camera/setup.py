from glob import glob

from setuptools import find_packages, setup

package_name = 'dvs_event_camera'

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
    description='Event camera (DVS): luminosity or images in, precisely stamped polarity events out.',
    license='Apache-2.0',
    entry_points={
        'console_scripts': [
            'event_camera = dvs_event_camera.event_camera_node:main',
            'packet_bridge = dvs_event_camera.tools.packet_bridge_node:main',
            'scene = dvs_event_camera.tools.scene_node:main',
            'show_events = dvs_event_camera.tools.show_events:main',
        ],
    },
)
