# The two commands of the README are `make run` and `make test`; both set up what they need.
PYTHON ?= python3
BIN := .venv/bin

.PHONY: run setup test check unit docs notebooks wheel lowest soak clean

run: setup
	@$(BIN)/skinlab

setup: .venv/.installed

# With uv, where it is there, in a fraction of pip's time. A kernel that changed is compiled again.
.venv/.installed: pyproject.toml hatch_build.py skinlab/mechanics/fem/kernel.c
	@test -x $(BIN)/python || $(PYTHON) -m venv .venv
	@echo "Installing skinlab and its tools into .venv ..." >&2
	@if uv --version >/dev/null 2>&1; then \
	  uv pip install --quiet --python $(BIN)/python --compile-bytecode --editable ".[dev]"; \
	else \
	  $(BIN)/python -m pip install --quiet --disable-pip-version-check --editable ".[dev]"; \
	fi
	@touch $@

test: check unit

# Style, types and architecture: fast, and broken first.
check: setup
	@$(BIN)/ruff check .
	@$(BIN)/ruff format --check .
	@$(BIN)/mypy
	@$(BIN)/lint-imports

unit: setup
	@OPENBLAS_NUM_THREADS=1 $(BIN)/python -m pytest -n auto --maxprocesses 4 --dist loadfile

# The pages of docs/ as a site in site/, command line and Python API from the code; runs every command
# in them.
docs: .venv/.docs
	@NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --quiet --strict
	@OPENBLAS_NUM_THREADS=1 $(BIN)/python -m pytest -q -n 2 -m docs tests/docs

notebooks: .venv/.notebook
	@OPENBLAS_NUM_THREADS=1 $(BIN)/python -m pytest -q -m notebook tests/docs

.venv/.docs .venv/.notebook: .venv/.%: .venv/.installed
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable ".[$*]"
	@touch $@

# Wheel and sdist, each installed into an empty environment and run there.
wheel: setup
	@$(BIN)/python tests/installed.py

# The same with the lowest versions of all dependencies.
lowest: setup
	@$(BIN)/python tests/installed.py --lowest

# Long: what the tests do once, many times, and a hundred measurements killed at random moments.
# Results are saved in benchmarks/results.
soak: setup
	@$(BIN)/python -m pytest -m soak
	@$(BIN)/python tests/system/kills.py --kills 100 --save benchmarks/results/kills.json >/dev/null

clean:
	rm -rf .venv site dist .mypy_cache .ruff_cache .pytest_cache .import_linter_cache
