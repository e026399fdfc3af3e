#!/usr/bin/env bash
# Style and types: ruff over everything, mypy over the packages.
cd "$(dirname "${BASH_SOURCE[0]}")/.." && source scripts/env.sh || exit 1
set -euo pipefail
ruff format --check .
ruff check --no-cache .
mypy ros2_ws/src/esfo_{core,frontend,backend,bringup}/esfo_*
