# Each target sets itself up: nothing is needed but Python 3.10+, pip and make.
# `make PYTHON=python3.12 test` chooses the interpreter of a new .venv.

PYTHON  ?= python3
WORKERS ?= 2
VENV    := .venv
RUN     := $(VENV)/bin/python
PIP     := $(RUN) -m pip --disable-pip-version-check install --quiet

.DEFAULT_GOAL := help
.DELETE_ON_ERROR:
.PHONY: help demo consistency figures bench test lint clean

help: ## show this list
	@awk -F ':.*## ' '/^[a-z]+:.*## /{printf "  make %-12s %s\n", $$1, $$2}' Makefile

demo: $(VENV)/.demo ## compare the paper's policies on eight rooms: table and pictures in results/demo
	$(RUN) -m agents compare --policies mi-constant mi-mi mi-fisher sweep --episodes 8 --seed 1000000 --out results/demo

consistency: $(VENV)/.demo ## is the filter consistent? 100 rooms a strategy, both initialisers (minutes): results/consistency
	$(RUN) -m agents consistency --episodes 100 --seed 2000000 --out results/consistency

figures: $(VENV)/.demo ## the paper's study over 100 rooms (15 minutes or more): results/figures, of which docs/ holds a copy
	$(RUN) -m agents study --episodes 100 --seed 1000000 --out results/figures

bench: $(VENV)/.bench ## how fast is it, beside others in the same run (minutes): results/bench
	$(RUN) -m benchmarks --out results/bench

test: lint ## lint, then every test but the slow ones
	$(RUN) -m pytest -n $(WORKERS)

lint: $(VENV)/.dev ## ruff (lint and format) and mypy
	$(RUN) -m ruff check .
	$(RUN) -m ruff format --check .
	$(RUN) -m mypy

clean: ## remove what the targets made (not results/)
	rm -rf $(VENV) build dist *.egg-info .pytest_cache .mypy_cache .ruff_cache .hypothesis
	find . -name __pycache__ -type d -prune -exec rm -rf {} +

# Stamps: a set of packages is installed anew when pyproject.toml changes. `demo` needs no torch, so has its own.

$(VENV)/.made:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 10) and "Python 3.10 or newer is needed: make PYTHON=python3.12 ...")'
	@echo "Making $(VENV) with $$($(PYTHON) --version)"
	@$(PYTHON) -m venv $(VENV)
	@$(PIP) 'pip>=23'
	@touch $@

$(VENV)/.demo: pyproject.toml | $(VENV)/.made
	@echo "Installing what the comparison needs into $(VENV) (once)"
	@$(PIP) --editable '.[compare]'
	@touch $@

$(VENV)/.bench: pyproject.toml | $(VENV)/.made
	@echo "Installing what the benchmark needs into $(VENV) (once)"
	@$(PIP) --editable '.[bench]'
	@touch $@

$(VENV)/.dev: pyproject.toml | $(VENV)/.made
	@echo "Installing what the tests need, PyTorch among it, into $(VENV) (once; takes a few minutes)"
	@$(PIP) --editable '.[agents,compare,dev,plot]'
	@touch $@
