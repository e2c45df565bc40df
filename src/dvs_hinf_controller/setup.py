from glob import glob

from setuptools import find_packages, setup

package_name = 'dvs_hinf_controller'

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
    description='Zero-order-hold estimator and H-infinity / mu / peak-to-peak controller on polarity events.',
    license='Apache-2.0',
    entry_points={
        'console_scripts': [
            'design_controller = dvs_hinf_controller.design.design_tool:main',
            'hinf_controller = dvs_hinf_controller.hinf_controller_node:main',
        ],
    },
)
