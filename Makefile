# Set-up, tests and the demo. `make demo` and `make test` need python3 (with venv), make and git only.

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
WORKERS ?= 2
LOCKED := $(VENV)/.locked
INSTALLED := $(VENV)/.installed

.PHONY: demo test nightly lint format bench lock clean

demo: $(INSTALLED)
	$(BIN)/linktwin demo --out out/demo

# Each of the many processes that tests start would otherwise compile the same packages' Python again.
unexport PYTHONDONTWRITEBYTECODE

PYTEST := $(BIN)/python -m pytest -n $(WORKERS) --dist loadscope --no-loadscope-reorder tests

test: $(INSTALLED)
	$(PYTEST) -m "not nightly"

# Tests that take minutes; then forty studies of hidden causes, made by other engines, diagnosed and scored, which goes on
# where it was stopped. Causes that switch on, each a program of its own to compile, are neither drawn nor asked for there.
SMOOTH := $(addprefix --without ,clearance joint_stop link_flexibility pin_friction)

nightly: $(INSTALLED)
	$(PYTEST) -m nightly
	$(BIN)/linktwin blind --n 40 --seed 7 --mechanism pendulum $(SMOOTH) --workers $(WORKERS) --out out/nightly

lint: $(INSTALLED)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/pyright --pythonpath $(BIN)/python
	$(BIN)/lint-imports

format: $(INSTALLED)
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

# Each benchmark prints what it measured; each runs alone as `python -m benchmarks.NAME`.
BENCHMARKS := $(basename $(notdir $(shell grep -l __main__ benchmarks/*.py)))
bench: $(INSTALLED)
	@for name in $(BENCHMARKS); do echo "== $$name"; $(BIN)/python -m benchmarks.$$name || exit 1; done

# Universal: one lock for every Python from 3.11 up. Hosts of registries stay out of it, and so does the extra s3, whose
# botocore would take python-dateutil back from 4 to 2.9.
lock: $(INSTALLED)
	$(BIN)/uv pip compile pyproject.toml $(addprefix --extra ,cad service peers dev) --universal --generate-hashes \
	    --no-emit-index-url --no-header --quiet --output-file requirements.lock

clean:
	rm -rf $(VENV) out dist build .pytest_cache .ruff_cache .hypothesis .import_linter_cache
	rm -f backend/simulate/kernel/*.so

# uv installs the lock five times faster than pip. Where only pip is set up to reach packages, pip does it:
# the same versions, the same hashes.
$(LOCKED): requirements.lock
	$(PYTHON) -m venv $(VENV)
	awk '/^[^ #]/ {ours = /^uv==/} ours' requirements.lock > $(VENV)/uv.txt
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --require-hashes -r $(VENV)/uv.txt
	$(BIN)/uv pip sync --quiet --python $(BIN)/python --require-hashes requirements.lock \
	    || $(BIN)/python -m pip install --disable-pip-version-check --require-hashes -r requirements.lock
	touch $@

# The compiled kernel is optional: where there is no C++ compiler, one line says so and the set-up goes on.
$(INSTALLED): $(LOCKED) pyproject.toml $(wildcard backend/simulate/kernel/*.cpp backend/simulate/kernel/*.h)
	$(BIN)/uv pip install --quiet --python $(BIN)/python --no-deps --no-build-isolation --editable .
	$(BIN)/python -m backend.simulate.kernel
	touch $@
