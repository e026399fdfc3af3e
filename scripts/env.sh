# Source this in bash: the environment in which `esfo` and the nodes run. `make setup` comes first.
_esfo_root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)

if [ ! -f "$_esfo_root/.venv/.esfo-workspace" ]; then
  echo "env.sh: nothing is built yet; run make setup" >&2
  unset _esfo_root
  return 1
fi

_esfo_ros=$(cat "$_esfo_root/.venv/.esfo-ros")
if [ "$_esfo_ros" = wheels ]; then
  # The wheels find their libraries when Python starts, unless this guard of another environment is inherited.
  unset _ROS_WHEELS_BOOTSTRAP_COMPLETE
  case ":${AMENT_PREFIX_PATH:-}:" in
    *":$_esfo_root/.venv:"*) ;;
    *) export AMENT_PREFIX_PATH="$_esfo_root/.venv${AMENT_PREFIX_PATH:+:$AMENT_PREFIX_PATH}" ;;
  esac
fi
[ "${VIRTUAL_ENV:-}" = "$_esfo_root/.venv" ] || source "$_esfo_root/.venv/bin/activate"
if [ "$_esfo_ros" = wheels ]; then
  source "$_esfo_root/ros2_ws/install/local_setup.bash"
else
  source "$_esfo_root/ros2_ws/install/setup.bash" # the ROS install and every workspace that was sourced at build time, too
fi
unset _esfo_root _esfo_ros
