# The two commands of the README are `make run` and `make test`; both set up what they need.
PYTHON ?= python3
BIN := .venv/bin

# More processes than two cores have: half of the tests' time is spent waiting for a probe or a terminal.
# Their files come in turn with those that compute: tests/conftest.py.
TESTS := -n 4 --dist loadfile --no-loadscope-reorder --durations=20

.PHONY: run setup test test-long check style types unit docs notebooks wheel lowest locked lock soak clean

run: setup
	@$(BIN)/skinlab

setup: .venv/.installed

# By uv, in a fraction of pip's time: pip fetches it where the machine has none, and does the work where it
# cannot. A kernel that changed is compiled again.
.venv/.installed: pyproject.toml hatch_build.py skinlab/mechanics/fem/kernel.c
	@test -x $(BIN)/python || $(PYTHON) -m venv .venv
	@echo "Installing skinlab and its tools into .venv ..." >&2
	@uv=uv; uv --version >/dev/null 2>&1 || { uv=$(BIN)/uv; \
	  $(BIN)/python -m pip install --quiet --disable-pip-version-check uv >/dev/null 2>&1 || true; }; \
	$$uv pip install --quiet --python $(BIN)/python --compile-bytecode --editable ".[dev]" || \
	  $(BIN)/python -m pip install --quiet --disable-pip-version-check --editable ".[dev]"
	@$(BIN)/python -m compileall -q skinlab drivers sim_device # also where PYTHONDONTWRITEBYTECODE is set
	@touch $@

# Style is broken first. Types take as much of a processor as a tenth of the tests: `make check`, and CI.
test: style unit

check: style types

style: setup
	@$(BIN)/ruff check --quiet .
	@$(BIN)/ruff format --check --quiet .

# Types and architecture; says nothing where all is well.
types: setup
	@said=$$($(BIN)/lint-imports 2>&1) || { echo "$$said"; exit 1; }
	@$(BIN)/mypy --no-error-summary

unit: setup
	@OPENBLAS_NUM_THREADS=1 $(BIN)/python -m pytest $(TESTS)

# Whole campaigns, visits and killed studies, each some seconds: CI runs them after `make test`.
test-long: setup
	@OPENBLAS_NUM_THREADS=1 $(BIN)/python -m pytest $(TESTS) -m long

# The pages of docs/ as a site in site/, command line and Python API from the code; runs the commands
# in them.
docs: .venv/.docs
	@NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --quiet --strict
	@OPENBLAS_NUM_THREADS=1 $(BIN)/python -m pytest -q -n 2 -m docs tests/docs tests/unit/api

notebooks: .venv/.notebook
	@OPENBLAS_NUM_THREADS=1 $(BIN)/python -m pytest -q -m notebook tests/docs

.venv/.docs .venv/.notebook: .venv/.%: .venv/.installed
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable ".[$*]"
	@touch $@

# Wheel and sdist into dist/, each installed into an empty environment and run there; beside them the
# list of all that the wheel stands on, as CycloneDX.
wheel: setup
	@$(BIN)/python tests/installed.py --keep dist

# The same with the lowest versions of all dependencies.
lowest: setup
	@$(BIN)/python tests/installed.py --lowest

# The tests with exactly the versions of requirements-dev.lock, each held against its hash.
locked: .venv-locked/.installed
	@OPENBLAS_NUM_THREADS=1 .venv-locked/bin/python -m pytest $(TESTS)

.venv-locked/.installed: requirements-dev.lock
	@$(PYTHON) -m venv .venv-locked
	@.venv-locked/bin/python -m pip install --quiet --disable-pip-version-check \
	  --require-hashes -r requirements-dev.lock
	@.venv-locked/bin/python -m pip install --quiet --disable-pip-version-check \
	  --no-deps --no-build-isolation --editable .
	@touch $@

# Chooses these versions anew, as the ranges of pyproject.toml allow.
lock:
	@uv pip compile pyproject.toml --extra dev --universal --generate-hashes --upgrade --quiet \
	  --no-header -o requirements-dev.lock

# Long: what the tests do once, many times, and a hundred measurements killed at random moments.
# Results are saved in benchmarks/results.
soak: setup
	@$(BIN)/python -m pytest -m soak
	@$(BIN)/python tests/system/kills.py --kills 100 --save benchmarks/results/kills.json >/dev/null
	@$(BIN)/python tests/system/liars.py --rounds 10 --save benchmarks/results/liars.json >/dev/null

clean:
	rm -rf .venv .venv-locked site dist .mypy_cache .ruff_cache .pytest_cache .import_linter_cache
