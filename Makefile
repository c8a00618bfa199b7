# The commands of a developer. Everything runs in $(VENV), made from the committed lock; only python3 (3.11 or newer) must exist.
PYTHON ?= python3
VENV ?= .venv
BIN := $(VENV)/bin
STAMP := $(VENV)/installed
# libsumo is linked against these, although nothing is ever drawn with them.
LIBRARIES := libatomic1 libexpat1 libgl1 libx11-6 libxext6 libxrender1
# Byte code is kept: tests start hundreds of processes, and without it each compiles all that it imports.
PYTEST := PYTHONDONTWRITEBYTECODE= $(BIN)/python -m pytest
# What `make test` runs, and more options of pytest; .ci/run makes two parts of it.
MARKS ?= not full
OPTIONS ?=
# The suite that has all others as its parts.
WHOLE := mdrive
# What pyright checks (pyproject.toml).
TYPED := $(foreach folder,mdrive_sumo networks real2sim server tools tests,"$(folder)/*.py")
# Python keeps what it compiled: else each process of the tests compiles all modules again, and pytest all assertions.
unexport PYTHONDONTWRITEBYTECODE
.DEFAULT_GOAL := help
.PHONY: help install libraries eval test test-all mutants check lint types changed-types imports bench platforms docs networks scenarios schemas validate lock clean

help: ## this list
	@grep -hE '^[a-z-]+:.*## ' $(MAKEFILE_LIST) | sed -E 's/:.*## /\t/' | expand -t 14

# The compiled layer of this clone: built by the installation, and anew when a C file has changed.
LAYER := mdrive_sumo/core/compiled/layer.abi3.so
C_FILES := $(shell find mdrive_sumo real2sim -name '*.c' -o -name '*.h')

$(STAMP): requirements.lock pyproject.toml
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and "mdrive-sumo needs Python 3.11 or newer, found " + sys.version.split()[0])'
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-deps --no-compile --require-hashes -r requirements.lock
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-deps --no-build-isolation -e .
	@$(BIN)/python -c 'import libsumo' 2>/dev/null || $(MAKE) --no-print-directory libraries
	touch $@

$(LAYER): $(STAMP) hatch_build.py $(C_FILES)
	$(BIN)/python hatch_build.py
	@touch $@

install: $(STAMP) $(LAYER) ## the environment

libraries: ## system libraries of SUMO, on Debian and Ubuntu
	@test "$$(id -u)" = 0 || { echo 'libsumo does not load here; it needs: sudo apt-get install $(LIBRARIES)'; exit 1; }
	apt-get -qq update && DEBIAN_FRONTEND=noninteractive apt-get -qq install -y --no-install-recommends $(LIBRARIES)

eval: install ## drive the built-in InterDrive suite with the idm baseline
	$(BIN)/mdrive-sumo eval --suite interdrive@0 --agent idm

test: install ## the tests
	$(PYTEST) -n 4 --dist worksteal -m "$(MARKS)" $(OPTIONS)

test-all: install ## every test: each scenario, each log, long soaks
	TESTS_PROFILE=all $(PYTEST) -n 2
	$(MAKE) --no-print-directory mutants

mutants: install ## small changes of the source, in copies: tests have to notice nine of ten
	PYTHONPATH=tests $(BIN)/python -m testing.mutation_job

check: lint changed-types imports ## lint, types of changed files, import contracts, fast tests
	TESTS_PROFILE=check $(PYTEST) -n 2 --dist worksteal -m "not slow and not full" -q

lint: install
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

types: install
	$(BIN)/pyright --pythonpath $(BIN)/python

# Since the branch left main, and what is not committed; all files take two minutes and a half.
CHANGED = $(shell git diff --name-only --diff-filter=d $$(git merge-base HEAD main 2>/dev/null || echo HEAD) -- $(TYPED); \
	git ls-files --others --exclude-standard -- $(TYPED))

changed-types: install
	$(if $(strip $(CHANGED)),$(BIN)/pyright --pythonpath $(BIN)/python $(CHANGED),@echo 'no file was changed: make types checks all')

imports: install
	$(BIN)/lint-imports --no-cache

bench: install ## measure, print tables, write bench.json
	$(BIN)/python tests/bench/speed.py
	$(BIN)/python tests/bench/jobs.py
	$(BIN)/python tests/bench/rl.py
	$(BIN)/python tests/bench/bench.py
	$(BIN)/python tests/bench/cameras.py
	$(BIN)/python tests/bench/sandbox.py
	$(BIN)/python tests/bench/store.py sqlite
	$(BIN)/python tests/bench/server.py --workers 2
	$(BIN)/python tests/bench/submission.py
	$(BIN)/python tests/bench/drive.py
	$(BIN)/python tests/bench/drive_latency.py --delay 0 --delay 150
	$(BIN)/python tests/bench/view_3d.py
	$(BIN)/python tests/bench/saved_states.py

platforms: install ## the same digests with other processor features and the oldest NumPy
	mkdir -p build
	$(BIN)/python -m tools.compare_platforms write build/digests.json
	$(BIN)/python -m tools.compare_platforms variants build/digests.json
	$(BIN)/python -m pip install --quiet --no-deps --upgrade --target build/oldest-numpy numpy==2.0.2
	PYTHONPATH=build/oldest-numpy $(BIN)/python -m tools.compare_platforms compare build/digests.json

docs: install ## build the documentation site into site/, without a network
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build

networks: install ## compile networks/ anew from their recipes
	$(BIN)/python -m tools.build_networks

scenarios: install ## write the built-in scenarios anew from their table
	$(BIN)/python -m tools.build_interdrive_suite
	$(BIN)/mdrive-sumo validate interdrive@0 --write

schemas: install ## write docs/schemas/ anew from the code
	mkdir -p docs/schemas
	for what in results contract scenario network suite reference-times need proposal episode open-loop training-data; do \
	  $(BIN)/mdrive-sumo schema $$what > docs/schemas/$$what.json || exit 1; done

validate: install ## check every built-in scenario: starts, difficulty, feasibility, statistics, certificates, checksums
	$(BIN)/mdrive-sumo validate $(WHOLE)

# All extras but `learn`: evaluating needs no PyTorch, and .ci/run installs it apart for the tests of training.
LOCKED := $(foreach extra,camera convert dask dev docs export learned notebook rl search server,--extra $(extra))

lock: ## pin all versions anew (needs uv)
	uv pip compile pyproject.toml $(LOCKED) --universal --python-version 3.11 --generate-hashes \
	  --no-emit-index-url --no-header --no-annotate --upgrade --quiet -o requirements.lock

clean: ## remove the environment, caches and builds; runs/ stays
	rm -rf $(VENV) build dist .pytest_cache .ruff_cache .hypothesis .import_linter_cache
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
