# The two commands of the README are `make run` and `make test`; both set up what they need.
PYTHON ?= python3
BIN := .venv/bin

.PHONY: run setup test check unit soak clean

run: setup
	@$(BIN)/skinlab

setup: .venv/.installed

.venv/.installed: pyproject.toml
	@test -x $(BIN)/python || $(PYTHON) -m venv .venv
	@echo "Installing skinlab and its tools into .venv ..." >&2
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable ".[dev]"
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

# Long: what the tests do once, many times, and a hundred measurements killed at random moments.
# Results are saved in benchmarks/results.
soak: setup
	@$(BIN)/python -m pytest -m soak
	@$(BIN)/python tests/system/kills.py --kills 100 --save benchmarks/results/kills.json >/dev/null

clean:
	rm -rf .venv .mypy_cache .ruff_cache .pytest_cache .import_linter_cache
