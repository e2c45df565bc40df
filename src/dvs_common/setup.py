from setuptools import find_packages, setup

package_name = 'dvs_common'

setup(
    name=package_name,
    version='0.1.0',
    packages=find_packages(exclude=['test']),
    package_data={package_name: ['py.typed']},
    data_files=[
        ('share/ament_index/resource_index/packages', [f'resource/{package_name}']),
        (f'share/{package_name}', ['package.xml']),
    ],
    install_requires=['setuptools'],
    zip_safe=False,
    maintainer='DVS regulation developers',
    maintainer_email='maintainers@example.org',
    description='Wire contract of the suite: model, parameters, codecs, QoS and the base of every node.',
    license='Apache-2.0',
    entry_points={
        'console_scripts': [],
    },
)
