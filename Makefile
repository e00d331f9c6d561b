# `make demo` and `make test` need nothing but Python 3.11 or later and the package index.

PYTHON ?= python3
BIN := .venv/bin

.PHONY: demo test lint clean

# The demo owns out/demo, so a second run may replace what the first one left there.
demo: .venv/ready
	$(BIN)/pdssjax identify --out out/demo --overwrite

test: .venv/ready
	$(BIN)/python -m pytest

lint: .venv/ready
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/basedpyright --pythonpath $(BIN)/python

clean:
	rm -rf .venv out dist

# Made anew whenever the lock changes; the stamp comes last, so that a broken install is not kept.
.venv/ready: requirements.lock pyproject.toml
	@$(PYTHON) -c 'import sys; sys.version_info >= (3, 11) or sys.exit("pdssjax needs Python 3.11 or later, but $(PYTHON) is " + sys.version.split()[0])'
	$(PYTHON) -m venv --clear .venv
	$(BIN)/python -m pip install --disable-pip-version-check -r requirements.lock
	$(BIN)/python -m pip install --disable-pip-version-check --no-deps --no-build-isolation -e .
	touch $@
