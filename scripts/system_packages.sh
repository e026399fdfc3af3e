#!/usr/bin/env bash
# Installs what a machine with ROS 2 needs, as root, after apt-get update:
#   scripts/system_packages.sh run      what the packages use when they run, by rosdep
#   scripts/system_packages.sh build    also what builds them
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
: "${ROS_DISTRO:?no ROS 2 is sourced}"
# Newer ones than the distribution has come into .venv, pinned in requirements/.
locked=(
  python3-h5py python3-matplotlib python3-numba python3-numpy python3-pil python3-rosbags-pip python3-scipy python3-tqdm
  python3-trimesh-pip python3-yaml
)

case ${1:-} in
  run) kinds=(--dependency-types exec) ;;
  build)
    kinds=()
    apt-get install -qy --no-install-recommends g++ make python3-dev python3-venv
    ;;
  *)
    echo "system_packages: say run or build" >&2
    exit 1
    ;;
esac
rosdep install --from-paths ros2_ws/src --ignore-src --rosdistro "$ROS_DISTRO" --skip-keys "${locked[*]}" -y "${kinds[@]}"
