# Everything that a developer types. `make` alone lists it.

PYTHON ?= $(shell if python3.11 -c '' 2>/dev/null; then echo python3.11; else echo python3; fi)
UV ?= .venv/bin/uv
UPGRADE ?=
CASES ?=
EXTRAS ?=

BIN := .venv/bin
TESTS := .:tests:packages/minorloop/tests:packages/minorloop-head/tests
CORE := .venv/.core
STAMP := .venv/.installed
LOCK := requirements.lock
CORE_LOCK := requirements-core.lock
JUDGE_LOCK := requirements-judge.lock
SCENES ?= 200

STATIC := packages/minorloop/src/minorloop/page/static packages/minorloop-head/src/minorloop_head/console/static
PAGES := $(firstword $(STATIC))/lab.html
# The pages are built where there is a node to build them; without, everything else still works.
BUILT := $(if $(shell command -v npm 2>/dev/null),$(PAGES),)

# The tests start hundreds of processes; without files of bytecode each would compile the package anew.
unexport PYTHONDONTWRITEBYTECODE

.DEFAULT_GOAL := help
.PHONY: help setup demo docs pages console screenshots studies test test-all expected compare torture check bench real judge figures format lock wheel smoke licences fuzz clean

help: ## list these targets
	@awk -F ':.*## ' '/^[a-z-]+:.*## / { printf "make %-11s %s\n", $$1, $$2 }' Makefile

setup: $(STAMP) ## create .venv with the locked versions and this project in it

demo: $(CORE) ## identify, invert and drive a simulated actuator; the result is in demo/
	rm -f demo/report.html demo/staircase.csv demo/model.json
	$(BIN)/minorloop demo --out demo

pages: $(PAGES) ## build the lab page and the operate page into their packages; needs node

console: setup $(BUILT) ## steer a simulated catheter head, and identify models, in a browser
	$(BIN)/minorloop console

screenshots: setup $(PAGES) ## take the pictures of the pages for the README anew; needs chromium
	MINORLOOP_SCREENSHOTS=docs/figures $(BIN)/python -m pytest -n 0 -m "" packages/minorloop/tests/page/test_pages.py packages/minorloop-head/tests/console/test_pages.py

studies: setup ## the papers on 20 simulated specimens, the design study on 10; reports in studies/
	rm -rf studies
	$(BIN)/python -m papers ipmc --specimens 20 --out studies/ipmc
	$(BIN)/python -m papers fibre --specimens 20 --out studies/fibre
	$(BIN)/python -m papers design --specimens 10 --out studies/design
	$(BIN)/python -m papers benchmark --specimens 10 --out studies/benchmark
	$(BIN)/python -m papers stage --specimens 20 --out studies/stage
	$(BIN)/python -m papers head --specimens 20 --out studies/head
	$(BIN)/python -m papers inspection --specimens 20 --out studies/inspection

test: setup $(BUILT) ## run the tests; those in a browser where there is one
	$(BIN)/python -m pytest

test-all: setup $(BUILT) ## run the whole tours in a browser and whole studies too
	$(BIN)/python -m pytest -m ""

expected: setup $(BUILT) ## write the figures that every part is expected to give; CASES="models bench" for some
	PYTHONPATH=$(TESTS) $(BIN)/python -m expected write $(CASES)

compare: setup $(BUILT) ## compute them anew and print a line for each that differs; CASES=--quick for those of seconds
	PYTHONPATH=$(TESTS) $(BIN)/python -m expected compare $(CASES)

torture: setup $(BUILT) ## go wrong at every line of runs, kill runs, fleets and the console; prints what was left on or lost
	PYTHONPATH=$(TESTS) $(BIN)/python -m faults 670
	$(BIN)/python -m pytest -m whole packages/minorloop/tests/fleet/test_lost.py
	$(BIN)/python -m benchmarks --only faults
	MINORLOOP_KILLED_RUNS=50 $(BIN)/python -m pytest packages/minorloop/tests/cli/test_resume.py -k killed

check: setup ## check format, style, types and who imports whom
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/mypy
	$(BIN)/lint-imports

bench: setup ## measure speed and accuracy
	$(BIN)/python -m benchmarks

real: setup ## lenses, scans and turns of heads that others recorded, in ../shared/data/real; prints figures
	$(BIN)/python -m benchmarks.real_lenses
	$(BIN)/python -m benchmarks.real_scans
	$(BIN)/python -m benchmarks.real_turns

judge: setup ## SCENES=200 seeds of another renderer, holes and cracks, and pits of a wave equation; prints scores. Needs libllvm 17 or newer
	$(INSTALL) --require-hashes -r $(JUDGE_LOCK)
	$(BIN)/python -m benchmarks.judge render --count $(SCENES)
	$(BIN)/python -m benchmarks.judge score --count $(SCENES)
	$(BIN)/python -m benchmarks.judge sound --count 3

figures: setup ## draw the figures of the README and the docs anew
	$(BIN)/python examples/docs_figures.py
	$(BIN)/python examples/readme_figures.py

docs: setup ## build the documentation into build/docs; every warning is an error
	$(BIN)/python -m sphinx --quiet --nitpicky --fail-on-warning --keep-going docs build/docs
	@echo "open build/docs/index.html"

format: setup ## format the code and mend what ruff can mend
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

COMPILE := $(UV) pip compile --quiet --universal --fork-strategy fewest --generate-hashes \
  --no-emit-package minorloop --no-header --no-annotate --no-emit-index-url --no-emit-find-links

lock: ## write all locks anew; UPGRADE="numpy scipy" moves those packages on
	@$(UV) --version >/dev/null 2>&1 || { echo "uv is missing; run 'make setup' first, or name one with UV=uv" >&2; exit 1; }
	$(COMPILE) --group pyproject.toml:dev --all-extras $(addprefix --upgrade-package ,$(UPGRADE)) --output-file $(LOCK) packages/minorloop/pyproject.toml packages/minorloop-head/pyproject.toml
	$(COMPILE) --group pyproject.toml:build --constraint $(LOCK) --output-file $(CORE_LOCK) packages/minorloop/pyproject.toml
	$(COMPILE) --group pyproject.toml:judge --constraint $(LOCK) --output-file $(JUDGE_LOCK) packages/minorloop/pyproject.toml
	@! grep -n '://' $(LOCK) $(CORE_LOCK) $(JUDGE_LOCK) || { echo "a lock names a download address; it must not" >&2; exit 1; }

wheel: setup $(PAGES) ## build both wheels and source distributions into dist/, pages included
	for each in packages/*; do (cd $$each && ../../$(BIN)/hatchling build -d ../../dist) || exit 1; done

smoke: setup $(BUILT) ## build, install in fresh environments and use, with each extra alone; EXTRAS="jax head" for some, EXTRAS=lowest with the lowest versions
	$(BIN)/python tests/packaging/smoke.py $(EXTRAS)

licences: setup ## list the licences of all installed dependencies
	@$(BIN)/python tests/packaging/licences.py

fuzz: setup ## damaged model files, tables and answers of instruments, CASES=100000 of them; prints counts
	PYTHONPATH=$(TESTS) $(BIN)/python -m fuzz $(or $(CASES),100000)

clean: ## remove what was built or cached; .venv stays
	rm -rf build dist demo studies console web/node_modules $(STATIC) .pytest_cache .mypy_cache .ruff_cache .import_linter_cache .hypothesis
	find packages papers tests benchmarks examples -name __pycache__ -prune -exec rm -rf {} +

$(PAGES): web/package-lock.json web/vite.config.ts $(wildcard web/*.html) $(wildcard web/src/*)
	npm --prefix web ci --no-audit --no-fund --loglevel=error
	npm --prefix web run --silent build

INSTALL := $(BIN)/python -m pip install --quiet --disable-pip-version-check

$(CORE): $(CORE_LOCK) packages/minorloop/pyproject.toml
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null || { \
	  echo "minorloop needs Python 3.11 or newer and '$(PYTHON)' is not; name one: make setup PYTHON=python3.12" >&2; \
	  exit 1; }
	@$(BIN)/python -m pip --version >/dev/null 2>&1 || $(PYTHON) -m venv --clear .venv
	$(INSTALL) --require-hashes -r $(CORE_LOCK)
	$(INSTALL) --no-deps --no-build-isolation -e packages/minorloop
	@touch $@

$(STAMP): $(CORE) $(LOCK) packages/minorloop-head/pyproject.toml
	$(INSTALL) --require-hashes -r $(LOCK)
	$(INSTALL) --no-deps --no-build-isolation -e packages/minorloop-head
	@touch $@
