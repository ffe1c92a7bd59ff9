# Everything runs in .venv, which the first target that needs it makes. `make help` lists the targets.

VENV := .venv
BIN := $(VENV)/bin
RUNTIME := $(VENV)/.runtime
INSTALLED := $(VENV)/.installed
POSTGRES := $(VENV)/.postgres
COMPILED := $(VENV)/.compiled
WEB := app/web
DESCRIBE := import json; from app.main import create_app; print(json.dumps(create_app().openapi()))
# Modules are compiled once and read by every process of the tests, also where the environment says otherwise.
unexport PYTHONDONTWRITEBYTECODE

SPREAD := -n 4 --dist worksteal --durations=10 --durations-min=1
CHECK_S := 35
CACHES := .mypy_cache .pytest_cache .ruff_cache .hypothesis .numba_cache .coverage*
UV_COMPILE := uv pip compile --quiet --no-header --no-strip-extras --no-emit-index-url --generate-hashes --python-version 3.11

.DEFAULT_GOAL := help
.DELETE_ON_ERROR:
.PHONY: help setup demo test test-all coverage fuzz soak docs tables web pictures check check-types check-tests lock clean

help:  ## list the targets
	@grep -hE '^[a-z-]+:.*## ' $(MAKEFILE_LIST) | sed -E 's/^([a-z-]+):.*## (.*)/  make \1\t\2/' | expand -t 16

setup: $(INSTALLED) $(POSTGRES) $(COMPILED)  ## make .venv, compile, and as root on Debian install PostGIS if it is missing

demo: $(RUNTIME) $(POSTGRES)  ## from nothing to slopes: the whole job on simulated drives, result in demo/
	@$(BIN)/versant demo --output demo

# Each process of the tests has its share of the cores: threads of linear algebra that wait for each other take a
# quarter more of the processor.
test test-all coverage fuzz check-tests: export OPENBLAS_NUM_THREADS := 1
test test-all coverage fuzz check-tests: export OMP_NUM_THREADS := 1

test: setup  ## every test but the long ones, on a private PostGIS, the pages' in Chromium; names the ten slowest
	@.ci/prepare chromium
	@.ci/prepare pgbouncer
	@$(BIN)/python -m pytest $(SPREAD) -m "not long"

test-all: setup  ## every test, also what is long by nature: a soak, fuzzers for a minute each, more examples, the plug-in in QGIS
	@.ci/prepare chromium
	@.ci/prepare pgbouncer
	@.ci/prepare qgis
	@FUZZ_SECONDS=$(or $(FUZZ),60) $(BIN)/python -m pytest $(SPREAD) --timeout=0 --hypothesis-profile=thorough

coverage: setup  ## which lines and branches the tests reach, in build/coverage/index.html
	@.ci/prepare chromium
	@.ci/prepare pgbouncer
	@$(BIN)/python -m pytest $(SPREAD) -m "not long" --cov --cov-report=term --cov-report=html:build/coverage

fuzz: setup  ## readers, routes and filters with inputs at random (FUZZ=600: seconds for each fuzzer)
	@FUZZ_SECONDS=$(or $(FUZZ),120) $(BIN)/python -m pytest -n 2 --dist worksteal --timeout=0 tests/fuzz

soak: setup  ## ten minutes of uploads, removals, imports and kills at random (SOAK=--seed 7: that one again)
	@PYTHONPATH=.:benchmarks $(BIN)/python -m soak $(SOAK)

docs: $(INSTALLED)  ## build docs/ as a site into docs/_build; a warning or a dead link fails
	@$(BIN)/python -m sphinx -q -W --keep-going -b html -d docs/_build/.doctrees docs docs/_build/html
	@echo "docs/_build/html/index.html"

tables: $(INSTALLED)  ## renew the tables of docs/ that come from the code
	@PYTHONPATH=.:tests/support $(BIN)/python tests/test_readme.py --write

web: $(INSTALLED)  ## build the pages anew into app/web/built, checked and tested (needs npm)
	@.ci/prepare npm $(WEB)
	@$(BIN)/python -c '$(DESCRIBE)' > $(WEB)/openapi.json
	@cd $(WEB) && npm run --silent types > /dev/null && npm run --silent check && npm test --silent && npm run --silent build

pictures: setup  ## draw the pages of the README anew, from a demonstration in Chromium
	@.ci/prepare chromium
	@PYTHONPATH=.:benchmarks $(BIN)/python -m service.pictures

check: $(INSTALLED)  ## linters, types, layout, contracts and the tests of what changed, in under a minute
	@$(BIN)/ruff check .
	@$(BIN)/ruff format --check .
	@$(MAKE) --no-print-directory -j2 --output-sync check-types check-tests

check-types:
	@$(BIN)/mypy

check-tests:
	@$(BIN)/python -m pytest -n 2 --dist loadfile -m "not slow and not long" -rs --seconds=$(CHECK_S) \
		--hypothesis-profile=quick $$($(BIN)/python tests/support/changed_tests.py)

lock: $(INSTALLED)  ## bring .lock/ up to pyproject.toml (UPGRADE=--upgrade: newest versions)
	@PATH="$$PWD/$(BIN):$$PATH"; command -v uv > /dev/null || $(BIN)/pip install --quiet uv
	@PATH="$$PWD/$(BIN):$$PATH"; $(UV_COMPILE) $(UPGRADE) --extra s3 --extra otel --extra batch pyproject.toml -o .lock/runtime.txt
	@PATH="$$PWD/$(BIN):$$PATH"; $(UV_COMPILE) $(UPGRADE) --extra s3 --extra otel --extra batch --extra dev -c .lock/runtime.txt pyproject.toml -o .lock/dev.txt

clean:  ## remove everything that make made
	rm -rf $(VENV) $(CACHES) build dist demo docs/_build *.egg-info
	find app fusion migrations tests benchmarks -name __pycache__ -prune -exec rm -rf {} +

$(VENV)/.made:
	@.ci/prepare venv $(VENV)
	@touch $@

# Python compiles what it imports when it does: of all packages beforehand that takes 20 s.
$(RUNTIME): $(VENV)/.made .lock/runtime.txt pyproject.toml
	@echo "Installing the locked dependencies into $(VENV) (a minute or some, 1 GB) ..."
	@$(BIN)/python -m pip install --quiet --no-compile --require-hashes -r .lock/runtime.txt
	@$(BIN)/python -m pip install --quiet --no-deps -e .
	@touch $@

$(INSTALLED): $(RUNTIME) .lock/dev.txt
	@echo "Installing what tests and linters need into $(VENV) ..."
	@$(BIN)/python -m pip install --quiet --no-compile --require-hashes -r .lock/dev.txt
	@touch $@

$(POSTGRES): $(RUNTIME) .ci/prepare
	@.ci/prepare postgis $(BIN)/python
	@touch $@

# Minutes once, where otherwise each process of the tests would compile the same loops.
$(COMPILED): $(INSTALLED) $(shell find fusion -name '*.py')
	@$(BIN)/python -m app.cli.compiling --processes 2
	@touch $@
