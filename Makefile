# make alone lists the targets.
SHELL := /bin/bash
.DEFAULT_GOAL := help
.PHONY: help setup demo test lint bench clean

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

bench: setup ## print the tables of docs/benchmarks.md
	@source scripts/env.sh && for script in benchmarks/*.py; do python $$script || exit 1; done

clean: ## remove all that setup and demo made
	rm -rf .venv demo ros2_ws/build ros2_ws/install ros2_ws/log
