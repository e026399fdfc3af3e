#!/usr/bin/env bash
# Simulates a spinning satellite, plays it through the ROS nodes and compares the result with the truth, into demo/.
cd "$(dirname "${BASH_SOURCE[0]}")/.." && source scripts/env.sh || exit 1
set -euo pipefail
# Nothing leaves this machine, and nodes of other people on it are not disturbed.
export ROS_AUTOMATIC_DISCOVERY_RANGE=${ROS_AUTOMATIC_DISCOVERY_RANGE:-LOCALHOST}
export ROS_DOMAIN_ID=${ROS_DOMAIN_ID:-$((RANDOM % 100 + 1))}

run() {
  echo "\$ $*"
  "$@"
}

# The same options give the same bytes, so an existing recording is as good as a new one.
if [[ ! -f demo/scene.truth.json || -n $(find ros2_ws/src/esfo_simulation/esfo_simulation -name '*.py' -newer demo/scene.truth.json) ]]; then
  run esfo simulate --object hubble --view diagonal --speed medium --revolutions 2.5 -o demo/scene.mcap
fi
run esfo live demo/scene.mcap -o demo
run esfo evaluate demo --truth demo/scene.truth.json --max-rate-error 0.5 --max-axis-error 1
echo "See demo/axis.png and demo/report.html; demo/orbit.json and demo/points.ply are for programs."
echo "For Foxglove: esfo run demo/scene.mcap -o demo/offline writes demo/offline/result.mcap, all topics over the recording."
