#!/usr/bin/env bash
# Runs a command in the environment of the workspace.
source /opt/esfo/scripts/env.sh || exit 1
exec "$@"
