# make alone lists the targets.
SHELL := /bin/bash
.DEFAULT_GOAL := help
.PHONY: help setup demo test lint docs mutate bench clean

help: ## show this list
	@sed -n 's/^\([a-z]*\):.*## /  make \1\t/p' Makefile | expand -t 16

setup: ## make .venv and build the ROS workspace (quick when nothing changed)
	@scripts/setup.sh

demo: setup ## simulate a spinning satellite and run it live through the ROS nodes, into demo/
	@scripts/demo.sh

test: setup ## run the tests
	@source scripts/env.sh && python -m pytest

lint: setup ## check style and types
	@scripts/lint.sh

docs: setup ## build the documentation site, without a network, into site/
	@source scripts/env.sh && NO_MKDOCS_2_WARNING=1 mkdocs build --strict --quiet

mutate: setup ## try mutants of a room on its tests: make mutate ROOM=orbit COUNT=40 (0: all mutants)
	@source scripts/env.sh && python scripts/mutate.py $(or $(ROOM),all) $(or $(COUNT),40)

bench: setup ## run all benchmarks (hours) and update docs/benchmarks.md
	@source scripts/env.sh && python benchmarks/document.py --all

clean: ## remove all that setup and demo made
	rm -rf .venv demo site ros2_ws/build ros2_ws/install ros2_ws/log
