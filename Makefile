# `make help` lists the targets. Everything runs in .venv, which is made on first use.

PYTHON ?= $(shell for python in python3 python3.13 python3.12 python3.11; do \
	"$$python" -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null && echo "$$python" && break; \
	done)
JOBS ?= 2
ARGS ?=

VENV := .venv
BIN := $(VENV)/bin
INSTALLED := $(VENV)/.installed-test
INSTALLED_BENCH := $(VENV)/.installed-bench
# The oldest versions that pyproject.toml takes of what the views are views for, before all else of .venv.
FLOOR := .venv-floor
INSTALLED_FLOOR := $(FLOOR)/.installed
FLOOR_VERSIONS := "gymnasium==1.1.*" "pettingzoo==1.26.*"
FLOOR_TESTS := $(addprefix tests/views/test_,clients.py parallel.py)
SOURCES := $(wildcard src baselines agents tests benchmarks reproductions docs train.py)

.DEFAULT_GOAL := help
.PHONY: help install train test unit floors nightly lint format types imports bench reproduce clean

help: ## list the targets
	@sed -n 's/^\([a-z]*\):.*## /\1\t/p' $(MAKEFILE_LIST) | expand -t 12

install: $(INSTALLED) ## make .venv and install everything in it

train: $(INSTALLED) ## train and compare on ThrusterMapping-v0; options in ARGS="..."
	$(BIN)/python train.py $(ARGS)

test: lint types imports unit floors ## everything that has to pass

unit: $(INSTALLED) ## the test suite alone; options in ARGS="..."
	$(BIN)/python -m pytest -n $(JOBS) $(ARGS)

floors: $(INSTALLED_FLOOR) ## tests of the views with the oldest Gymnasium and PettingZoo; options in ARGS="..."
	$(FLOOR)/bin/python -m pytest -n $(JOBS) $(ARGS) $(FLOOR_TESTS)

nightly: $(INSTALLED_BENCH) ## the slow tests that `make test` leaves out; options in ARGS="..."
	$(BIN)/python -m pytest -n $(JOBS) -m nightly $(ARGS)

lint: $(INSTALLED) ## ruff: lint and format
	$(BIN)/ruff check $(SOURCES)
	$(BIN)/ruff format --check $(SOURCES)

format: $(INSTALLED) ## rewrite the sources as `make lint` wants them
	$(BIN)/ruff check --fix $(SOURCES)
	$(BIN)/ruff format $(SOURCES)

types: $(INSTALLED) ## mypy in strict mode over src and baselines
	$(BIN)/mypy

imports: $(INSTALLED) ## who may import whom
	$(BIN)/lint-imports

bench: $(INSTALLED_BENCH) ## speed beside peers; writes docs/results/speed.md
	$(BIN)/python -m benchmarks $(ARGS)

reproduce: $(INSTALLED) ## recompute the sources' results; writes docs/results/reproductions.md; options in ARGS="..."
	$(BIN)/python -m reproductions run $(or $(ARGS),all)

clean: ## remove caches and builds; runs and .venv stay
	rm -rf build dist .pytest_cache .mypy_cache .ruff_cache .import_linter_cache .hypothesis
	find $(wildcard src baselines agents tests benchmarks reproductions) -name __pycache__ -type d -prune -exec rm -rf {} +

$(BIN)/python:
	@command -v "$(PYTHON)" >/dev/null || { \
		echo "Python 3.11 or newer is needed and none was found; install one, or name it: make PYTHON=/path/to/python3.11"; \
		exit 1; }
	@"$(PYTHON)" -c 'import sys; sys.exit(sys.version_info < (3, 11))' || { \
		echo "Python 3.11 or newer is needed; $(PYTHON) is $$("$(PYTHON)" --version 2>&1 | head -n 1); try make PYTHON=python3.11"; \
		exit 1; }
	@"$(PYTHON)" -c 'import ensurepip, venv' 2>/dev/null || { \
		echo "$(PYTHON) cannot make virtual environments; on Debian and Ubuntu: apt install python3-venv"; \
		exit 1; }
	"$(PYTHON)" -m venv $(VENV)

$(INSTALLED): pyproject.toml constraints.txt | $(BIN)/python
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -e ".[test]" -c constraints.txt
	@touch $@

$(INSTALLED_FLOOR): pyproject.toml constraints.txt | $(INSTALLED)
	$(BIN)/python -m venv $(FLOOR)
	$(FLOOR)/bin/python -m pip install --quiet --disable-pip-version-check --no-deps $(FLOOR_VERSIONS)
	$(BIN)/python -c 'import sys; print(*sys.argv[1:], *(p for p in sys.path if p.endswith("-packages")), sep="\n")' \
		$(addprefix $(CURDIR)/,src baselines agents) \
		> "$$($(FLOOR)/bin/python -c 'import sysconfig; print(sysconfig.get_path("purelib"))')/beneath.pth"
	@touch $@

$(INSTALLED_BENCH): pyproject.toml constraints.txt | $(INSTALLED)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -e ".[bench]" -c constraints.txt \
		|| echo "Some of the peers could not be installed; the benchmarks leave them out."
	@touch $@
