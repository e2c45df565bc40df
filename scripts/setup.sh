#!/usr/bin/env bash
# Sets up everything: ROS 2 Jazzy (from apt if it is there, else as wheels), a virtual environment
# in .venv and the workspace in install/. Seconds when nothing has changed.
set -euo pipefail
# shellcheck source=scripts/env.sh
source "$(dirname "${BASH_SOURCE[0]}")/env.sh"

usage() {
    cat <<'TEXT'
usage: scripts/setup.sh [--test]

Creates .venv and builds the workspace into install/. With ROS 2 Jazzy under /opt/ros/jazzy that ROS
is used; otherwise ROS comes from PyPI wheels (x86_64, Python 3.10 to 3.13).

  --test   also install what the tests and linters need
  --help   show this text

Environment: PYTHON        interpreter to use instead of the first suitable python3
             DVS_ROS       "wheels" ignores a ROS from apt
TEXT
}

with_tests=no
for argument in "$@"; do
    case $argument in
        --test) with_tests=yes ;;
        --help) usage; exit 0 ;;
        *) usage >&2; exit 2 ;;
    esac
done

is_suitable() {
    "$1" -c 'import sys; sys.exit(not (3, 10) <= sys.version_info[:2] <= (3, 13))' 2>/dev/null
}

find_python() {
    local candidate
    for candidate in ${PYTHON:+"$PYTHON"} python3 python3.12 python3.13 python3.11 python3.10; do
        if command -v "$candidate" >/dev/null && is_suitable "$candidate"; then
            command -v "$candidate"
            return
        fi
    done
    fail "no Python 3.10 to 3.13 found; install one or name it: PYTHON=/path/to/python3 scripts/setup.sh"
}

make_venv() {
    local python=$1 options=()
    if has_apt_ros; then options=(--system-site-packages); fi
    if ! "$python" -m venv "${options[@]}" "$venv" >"$log" 2>&1; then
        rm -rf "$venv"
        tail -n 3 "$log" >&2
        fail "$python can't make a virtual environment (on Debian and Ubuntu: apt install python3-venv)"
    fi
}

check_disk() {
    local free_kb
    free_kb=$(df -Pk "$root" | awk 'NR == 2 {print $4}')
    [ "$free_kb" -ge 2500000 ] ||
        fail "only $((free_kb / 1024)) MB of disk are free in $root; 2500 MB are needed"
}

require_writable() {
    [ -w "$root" ] ||
        fail "$root can't be written by $(id -un): set it up as $(stat -c %U "$root"), or use a clone of your own"
}

install_packages() {
    echo "installing Python packages (a minute or two the first time) ..."
    # What is imported is compiled then: compiling all of every package takes as long as the rest.
    if ! "$venv/bin/python" -m pip install --disable-pip-version-check --no-compile -q "$@" \
        >"$log" 2>&1; then
        grep -E 'ERROR|error|No space' "$log" | tail -n 5 >&2
        fail "pip could not install the packages; is there a network, or a package index? (log: $log)"
    fi
}

# A stamp file holds the checksum of what a step depends on: the step runs when that has changed.
is_current() { [ -f "$1" ] && [ "$(cat "$1")" = "$2" ]; }

checksum() { cat "$@" | sha256sum | cut -d ' ' -f 1; }

# Built by the environment's own interpreter, so that executables find what is installed there.
build() {
    "$venv/bin/python" -c 'import sys; from colcon_core.command import main; sys.exit(main())' \
        --log-base log build --symlink-install
}

# Programs as setuptools writes them search the metadata of all packages at every start.
write_programs() {
    local program package interpreter
    for program in "$root"/install/*/lib/dvs_*/*; do
        grep -q load_entry_point "$program" || continue
        package=$(basename "$(dirname "$program")")
        read -r interpreter <"$program"
        # What a worker process imports of its parent must not run.
        printf '%s\n' "$interpreter" 'import sys' '' \
            "from $package.programs import $(basename "$program") as main" '' \
            "if __name__ == '__main__':" '    sys.exit(main())' \
            >"$program"
    done
}

# colcon and setuptools write the interpreter's path as it is, which ends at its first space.
quote_interpreter() {
    find "$root/install" -maxdepth 1 -name 'local_setup.*' -exec \
        sed -i 's/(\$_colcon_python_executable /("$_colcon_python_executable" /' {} +
    find "$root/install" -path '*/lib/*' -type f -perm -u+x -exec \
        sed -i "1s|^#!\(\".*\"\).*|#!/bin/sh\n'''exec' \1 \"\$0\" \"\$@\"\n' '''|" {} +
}

log=$(mktemp -t dvs-setup-XXXXXX.log)
requirements=("$root/requirements.txt")
if has_apt_ros; then
    echo "ROS 2 Jazzy: from apt, $ros_prefix"
    python=${PYTHON:-/usr/bin/python3}
else
    [ "$(uname -m)" = x86_64 ] ||
        fail "ROS 2 wheels exist for x86_64 only, this is $(uname -m); install ROS 2 Jazzy from apt instead"
    echo "ROS 2 Jazzy: from PyPI wheels, in .venv"
    python=$(find_python)
    requirements+=("$root/requirements-ros.txt")
fi
readers=()
if [ "$with_tests" = yes ]; then
    requirements+=("$root/requirements-test.txt")
    readers+=("$root/requirements-readers.txt")
fi

if [ ! -x "$venv/bin/python" ]; then
    require_writable
    check_disk
    make_venv "$python"
fi
wanted=$(checksum "${requirements[@]}" "${readers[@]}")
if ! is_current "$venv/.dvs-$with_tests" "$wanted"; then
    require_writable
    check_disk
    install_packages "${requirements[@]/#/--requirement=}"
    if [ "$with_tests" = yes ]; then install_packages --no-deps "${readers[@]/#/--requirement=}"; fi
    if has_apt_ros && ! command -v colcon >/dev/null; then
        install_packages colcon-common-extensions 'setuptools<80'
    fi
    echo "$wanted" >"$venv/.dvs-$with_tests"
fi

enter_ros
manifests=("$root"/src/*/package.xml "$root"/src/*/setup.py "$root"/src/*/setup.cfg)
wanted=$(checksum "${manifests[@]}" <(find "$root/src" -path '*/launch/*' -o -path '*/layouts/*' -o -path '*/resource/*') <(ls "$root/config" "$root"/src/*/*/__init__.py))
if ! is_current "$root/install/.dvs" "$wanted"; then
    require_writable
    echo "building the workspace ..."
    if ! (cd "$root" && build)  >"$log" 2>&1; then
        tail -n 20 "$log" >&2
        fail "colcon build failed (log: $log)"
    fi
    write_programs
    quote_interpreter
    echo "$wanted" >"$root/install/.dvs"
fi
# Kernels are compiled here, so that no first run is slow.
mapfile -t kernels < <(find "$root/src" -name '*.py' -not -path '*/test/*' -exec grep -lE '^@(kernel|jit)' {} +)
wanted=$(checksum "${kernels[@]}" "$root/scripts/compile_kernels.py")
if ! is_current "$root/install/.dvs-kernels" "$wanted"; then
    require_writable
    echo "compiling kernels (a minute or two the first time) ..."
    if (enter_workspace && python "$root/scripts/compile_kernels.py") >"$log" 2>&1; then
        echo "$wanted" >"$root/install/.dvs-kernels"
    else
        tail -n 1 "$log" >&2
        echo "the kernels could not be compiled now: first runs will be slow" >&2
    fi
fi
rm -f "$log"
echo "ready: scripts/run.sh PKG EXE, or 'source install/setup.bash' and ros2 run PKG EXE"
