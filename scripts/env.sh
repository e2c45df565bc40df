# Sourced by the other scripts: finds ROS, the virtual environment and the built workspace.
# shellcheck shell=bash
root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
venv="$root/.venv"
ros_prefix=${DVS_ROS_PREFIX:-/opt/ros/jazzy}

fail() {
    echo "$(basename "$0"): $*" >&2
    exit 1
}

has_apt_ros() {
    [ "${DVS_ROS:-}" != wheels ] && [ -f "$ros_prefix/setup.bash" ]
}

# The generated setup files read unset variables.
source_quietly() {
    set +u
    # shellcheck disable=SC1090
    source "$1"
    set -u
}

enter_ros() {
    if has_apt_ros; then
        [ "${ROS_DISTRO:-}" = jazzy ] || source_quietly "$ros_prefix/setup.bash"
    else
        case ":${AMENT_PREFIX_PATH:-}:" in
            *":$venv:"*) ;;
            *) export AMENT_PREFIX_PATH="$venv${AMENT_PREFIX_PATH:+:$AMENT_PREFIX_PATH}" ;;
        esac
    fi
    export PATH="$venv/bin:$PATH"
}

enter_workspace() {
    [ -f "$root/install/local_setup.bash" ] || fail "not set up yet: run scripts/setup.sh"
    enter_ros
    source_quietly "$root/install/local_setup.bash"
}

# The matrices here are small: threads of the linear algebra only get in each other's way.
export OPENBLAS_NUM_THREADS=${OPENBLAS_NUM_THREADS:-1}
