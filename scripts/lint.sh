#!/usr/bin/env bash
# Style and types: ruff over everything, mypy over the packages; then the documents, and the files that only Docker
# and the CI read.
cd "$(dirname "${BASH_SOURCE[0]}")/.." && source scripts/env.sh || exit 1
set -euo pipefail
ruff format --check .
ruff check --no-cache .
mypy ros2_ws/src/esfo_{core,simulation,ros,frontend,backend,bringup}/esfo_* ros2_ws/src/esfo_bringup/esfo
# Versions of apt packages cannot be pinned (DL3008): the ROS archive keeps only the newest.
hadolint --ignore DL3008 docker/Dockerfile
check-jsonschema --builtin-schema vendor.compose-spec docker/compose.yaml
check-jsonschema --builtin-schema vendor.github-workflows .github/workflows/ci.yaml
check-jsonschema --builtin-schema vendor.citation-file-format CITATION.cff
pre-commit validate-config .pre-commit-config.yaml
NO_MKDOCS_2_WARNING=1 mkdocs build --strict --quiet
