"""The package event_camera_msgs, generated from its message and compiled, without colcon."""

import json
import os
import subprocess
import sysconfig
from pathlib import Path

import numpy as np

# msg_ros2/EventPacket.msg of github.com/ros-event-camera/event_camera_msgs, without its comments.
MESSAGE = """std_msgs/Header header
uint32 height
uint32 width

uint64 seq
uint64 time_base
string encoding
bool is_bigendian

uint8[] events
"""
_PACKAGE = 'event_camera_msgs'
_EXPORTS = ('ROSIDL_GENERATOR_C', 'ROSIDL_TYPESUPPORT_FASTRTPS_C') + (
    'ROSIDL_TYPESUPPORT_INTROSPECTION_C',
    'ROSIDL_TYPESUPPORT_C',
)
_NEEDED = ('rosidl_*', 'std_msgs*_c', 'std_msgs*_py', 'builtin_interfaces*_c') + (
    'builtin_interfaces*_py',
    'rcutils',
    'fastcdr*',
)


def prefix():
    """Folder of ROS with the headers and descriptions of its messages; None if there is none."""
    found = [Path(path) for path in os.environ.get('AMENT_PREFIX_PATH', '').split(os.pathsep)]
    whole = [path for path in found if (path / 'share/std_msgs/msg/Header.json').exists()]
    return whole[0] if whole else None


def described(folder):
    """Write message, IDL and type description; return the path of the last."""
    from rosidl_adapter.msg import convert_msg_to_idl
    from rosidl_generator_type_description import generate_type_hash

    (folder / 'msg').mkdir()
    (folder / 'msg/EventPacket.msg').write_text(MESSAGE)
    convert_msg_to_idl(folder, _PACKAGE, Path('msg/EventPacket.msg'), folder / 'idl/msg')
    arguments = _arguments(folder, 'rosidl_generator_type_description', 'described')
    generate_type_hash(arguments)
    return folder / 'described/msg/EventPacket.json'


def compiled(folder):
    """Generate and compile the package; return the folder for PYTHONPATH and the libraries'."""
    import rosidl_generator_c
    import rosidl_typesupport_c
    import rosidl_typesupport_fastrtps_c
    import rosidl_typesupport_introspection_c
    from rosidl_generator_py.generate_py_impl import generate_py

    supports = ['rosidl_typesupport_fastrtps_c', 'rosidl_typesupport_introspection_c']
    for generate, name, target, *more in (
        (rosidl_generator_c.generate_c, 'rosidl_generator_c', 'c'),
        (rosidl_typesupport_introspection_c.generate_c, supports[1], 'described_c'),
        (rosidl_typesupport_fastrtps_c.generate_typesupport_fastrtps_c, supports[0], 'c'),
        (rosidl_typesupport_c.generate_c, 'rosidl_typesupport_c', 'c', supports),
        (generate_py, 'rosidl_generator_py', 'py', ['rosidl_typesupport_c']),
    ):
        (folder / target / _PACKAGE / 'msg').mkdir(parents=True, exist_ok=True)
        generate(_arguments(folder, name, f'{target}/{_PACKAGE}'), *more)
    _export_nothing(folder / 'c' / _PACKAGE / 'msg')
    package = folder / 'py' / _PACKAGE
    (package / '__init__.py').touch()
    return package.parent, _built(folder, package)


def _arguments(folder, generator, target):
    """Arguments of a generator, in a file as it wants them."""
    share = prefix() / 'share'
    path = folder / f'{generator}.json'
    arguments = {
        'package_name': _PACKAGE,
        'output_dir': str(folder / target),
        'idl_tuples': [f'{folder}/idl:msg/EventPacket.idl'],
        'template_dir': str(share / generator / 'resource'),
        'target_dependencies': [],
        'include_paths': [f'{name}:{share / name}' for name in ('std_msgs', 'builtin_interfaces')],
        'type_description_tuples': [
            f'msg/EventPacket.idl:{folder}/described/msg/EventPacket.json'
        ],
    }
    path.write_text(json.dumps(arguments))
    return str(path)


def _export_nothing(folder):
    """What CMake would write: which symbols a library shows."""
    lines = [
        f'#define {name}_{kind}_{_PACKAGE}'
        for name in _EXPORTS
        for kind in ('PUBLIC', 'EXPORT', 'IMPORT')
    ]
    for name in _EXPORTS:
        (folder / f'{name.lower()}__visibility_control.h').write_text('\n'.join(lines) + '\n')


def _built(folder, package):
    """Compile all into one library, and the extension for Python beside it."""
    root = prefix()
    includes = [f'-I{folder}/c', f'-I{folder}/described_c', f'-I{root}/include']
    includes += [f'-I{path}' for path in (root / 'include').iterdir() if path.is_dir()]
    objects = []
    for source in [*folder.glob('c/**/*.c*'), *folder.glob('described_c/**/*.c')]:
        objects.append(folder / f'{len(objects)}.o')
        compiler = 'g++' if source.suffix == '.cpp' else 'gcc'
        _run(compiler, '-fPIC', '-c', *includes, source, '-o', objects[-1])
    libraries = [path for name in _NEEDED for path in (root / 'lib').glob(f'lib{name}.so')]
    libraries.append(f'-Wl,-rpath,{root}/lib')
    library = package / f'lib{_PACKAGE}.so'
    _run('g++', '-shared', '-o', library, *objects, *libraries)
    for kind in ('fastrtps_c', 'introspection_c'):
        (package / f'lib{_PACKAGE}__rosidl_typesupport_{kind}.so').symlink_to(library)
    suffix = sysconfig.get_config_var('EXT_SUFFIX')
    python = [f'-I{sysconfig.get_paths()["include"]}', f'-I{np.get_include()}']
    sources = [*package.glob('*.c'), *package.glob('msg/*.c')]
    extension = package / f'{_PACKAGE}_s__rosidl_typesupport_c{suffix}'
    own = [library, f'-Wl,-rpath,{package}']
    _run(
        'gcc', '-shared', '-fPIC', *includes, *python, *sources, '-o', extension, *own, *libraries
    )
    return package


def _run(*command):
    subprocess.run([str(part) for part in command], check=True, capture_output=True, text=True)
