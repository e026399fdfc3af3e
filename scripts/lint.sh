#!/usr/bin/env bash
# Style and types: ruff over everything, mypy over the packages.
cd "$(dirname "${BASH_SOURCE[0]}")/.." && source scripts/env.sh || exit 1
set -euo pipefail
ruff format --check .
ruff check .
for package in core frontend backend bringup; do
  mypy "ros2_ws/src/esfo_$package/esfo_$package"
done
