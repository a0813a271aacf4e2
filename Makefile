# Everything is one command from a clean checkout; set-up happens when it is needed, once.
# make demo PYTHON=python3.12 picks another interpreter for .venv.

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
READY := $(VENV)/.ready
PYTEST := $(BIN)/python -m pytest
# Where the tests of the pages keep their pictures.
export TASKCOMM_ARTEFACTS ?= $(CURDIR)/test-artefacts

.DEFAULT_GOAL := help
.PHONY: help setup demo browser test lint types layers check verify bench bench-planner bench-planner-peers bench-estep study-horizons study-coverage study-recovery study-calibration study-structure clean

help:  ## what can be made
	@grep -hE '^[a-z-]+:.*##' $(MAKEFILE_LIST) | sed -E 's/^([a-z-]+):[^#]*## */\1\t/' | expand -t 21

setup: $(READY)  ## .venv with everything in it

# The mark is the last thing written: a set-up that broke off starts over; a finished one is brought up to date.
$(READY): pyproject.toml constraints.txt
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || { \
	  echo "taskcomm needs Python 3.11 or later; '$(PYTHON)' is `$(PYTHON) -V 2>&1`." \
	    "Name another: make setup PYTHON=python3.11" >&2; exit 1; }
	@if [ -e $@ ]; then rm $@; else echo "Setting up $(VENV) (a minute or two, once)"; \
	  $(PYTHON) -m venv --clear $(VENV); fi
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e '.[learn,web,dev]'
	@touch $@

demo: $(READY)  ## learn a teacher from the logged trials and compare the robots: demo-results/
	$(BIN)/taskcomm demo --out demo-results

browser: $(READY)  ## a Chromium for the tests of the pages: the one that is there, or Debian's
	@.ci/browser

test: $(READY) browser  ## every test but the long ones
	$(PYTEST) -n auto --dist worksteal

lint: $(READY)  ## formatting and lint
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .

types: $(READY)  ## mypy --strict
	$(BIN)/mypy

layers: $(READY)  ## who may import whom
	$(BIN)/lint-imports --no-logo

check: lint types layers test  ## lint, types, layers and tests

verify: $(READY) browser  ## the long tests and studies, and every random law on fresh examples
	$(PYTEST) -n auto --dist worksteal -m 'verify or hypothesis' --hypothesis-profile verify

bench: $(READY)  ## timings, each a ratio between two ways
	$(PYTEST) tests/benchmarks -o python_files='bench_*.py' -o python_functions='bench_*'

bench-planner: $(READY)  ## the search against a plain compiled tree, by horizon and balls; FULL=1 for all decisions
	PYTHONPATH=tests $(BIN)/python -m benchmarks.planner $(if $(FULL),--full)

bench-planner-peers: $(READY)  ## pymdp and pomdp-py, in environments of their own, on what they can express
	PYTHONPATH=tests $(BIN)/python -m benchmarks.planner.peers

bench-estep: $(READY)  ## the E-step against pomegranate and dynamax (in an environment of its own), the same answers
	PYTHONPATH=tests $(BIN)/python -m benchmarks.estep

study-horizons: $(READY)  ## does looking further help? hours, kept in notebooks/results/horizons; goes on where it stopped; ARGS="--minutes 60"
	$(BIN)/python -m learn.horizons --out notebooks/results/horizons $(ARGS)

study-coverage: $(READY)  ## do 95% intervals hold the truth? half an hour, kept in notebooks/results/; goes on where it stopped
	$(BIN)/python -m learn.coverage --out notebooks/results/coverage.csv $(ARGS)

study-recovery: $(READY)  ## would a fit find the truth? half an hour, kept in recovery-results/; tables in notebooks/results
	$(BIN)/python -m learn.recovery_study $(ARGS)

study-calibration: $(READY)  ## when a robot says 98%, how often is it right? minutes, kept in notebooks/results/
	$(BIN)/python -m learn.calibration_study $(ARGS)

study-structure: $(READY)  ## how many trials does it take to tell a structure? an hour, kept in structure-results/; goes on where it stopped
	$(BIN)/python -m learn.structure_study --out structure-results --jobs 2 $(ARGS)

clean:  ## remove .venv and everything made
	rm -rf $(VENV) demo-results test-artefacts build dist .pytest_cache .mypy_cache .ruff_cache .hypothesis \
	  .import_linter_cache .benchmarks
	find . -name __pycache__ -prune -exec rm -rf {} +
