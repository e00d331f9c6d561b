# `make demo` and `make test` need nothing but Python 3.11 or later and the package index.

PYTHON ?= python3
BIN := .venv/bin

# XLA logs 2 kB of errors that are none for every function it reads from its cache (jax issue 38445).
export TF_CPP_MIN_LOG_LEVEL ?= 3

.PHONY: demo test docs experiments bench lint wheel-check clean

# The demo owns out/demo, so a second run may replace what the first one left there.
demo: .venv/ready
	$(BIN)/pdssjax identify --out out/demo --overwrite

test: .venv/ready
	$(BIN)/python -m pytest -n auto --maxprocesses 4 --dist loadfile

# The site, in out/docs; its tutorials are executed.  A warning is an error, and nothing is fetched.
docs: .venv/ready-for-docs
	$(BIN)/python -m sphinx -W --keep-going -n -q -c docs -d out/docs-doctrees . out/docs
	@echo "The site is out/docs/index.html"

# Every experiment, with its table beside the thesis's numbers; out/experiments/index.html shows them all.
experiments: .venv/ready
	$(BIN)/python -m experiments

# Speed beside other simulators; what cannot be installed here is left out of the table.
bench: .venv/ready
	$(BIN)/python -m pip install --disable-pip-version-check --quiet --no-build-isolation -c requirements.lock -e '.[bench]'
	@$(BIN)/python -m pip install --disable-pip-version-check --quiet -c requirements.lock 'numbalsoda>=0.3.4' \
		|| echo 'numbalsoda, which is built by a Fortran compiler, did not install: the benchmark goes on without it.'
	$(BIN)/python -m benchmarks.speed

lint: .venv/ready
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/basedpyright --pythonpath $(BIN)/python

# What is released, installed where the repository is not, with the lowest and the newest versions of what it needs.
wheel-check: .venv/ready
	$(BIN)/python .ci/check_release.py

clean:
	rm -rf .venv out dist

# Made anew whenever the lock changes; the stamp comes last, so that a broken install is not kept.
.venv/ready: requirements.lock pyproject.toml
	@$(PYTHON) -c 'import sys; sys.version_info >= (3, 11) or sys.exit("pdssjax needs Python 3.11 or later, but $(PYTHON) is " + sys.version.split()[0])'
	$(PYTHON) -m venv --clear .venv
	$(BIN)/python -m pip install --disable-pip-version-check -r requirements.lock
	$(BIN)/python -m pip install --disable-pip-version-check --no-deps --no-build-isolation -e .
	touch $@

# What `make docs` needs besides, at versions that go with those of the other lock.
.venv/ready-for-docs: .venv/ready docs-requirements.lock
	$(BIN)/python -m pip install --disable-pip-version-check -r docs-requirements.lock
	touch $@
