PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
MUTATION := .venv-mutation
export OPENBLAS_NUM_THREADS := 1
export OMP_NUM_THREADS := 1
# Tests start many processes: Python is to keep what it has compiled for the next, whatever the shell says.
export PYTHONDONTWRITEBYTECODE :=
JOBS ?= 2

.PHONY: check-properties demo manual test test-all test-fast bench bench-all golden reproduce lint format fuzz licences mutation report clean

# pip fetches and unpacks one package after the other, 85 s where uv takes 25. Where uv cannot be had, or does not reach
# the index that pip is set up for, pip does it.
QUIET := --quiet --disable-pip-version-check
WANTED := --constraint constraints.txt --editable ".[test,lint,docs]"
INSTALL = $(BIN)/python -m pip install $(QUIET) uv==0.13.9 && $(BIN)/uv pip install --quiet --python $(BIN)/python $(WANTED)

# The environment is rebuilt whenever the pins or the project file change.
$(VENV)/.ready: pyproject.toml constraints.txt
	@$(PYTHON) -c "import sys; sys.exit(not (3, 11) <= sys.version_info[:2] <= (3, 13))" \
	  || (echo "excite needs Python 3.11, 3.12 or 3.13; say which with make PYTHON=python3.12 …" >&2; exit 1)
	$(PYTHON) -m venv --clear $(VENV)
	@$(INSTALL) || (echo "uv could not install it; pip does, which takes longer" >&2; $(BIN)/python -m pip install $(QUIET) $(WANTED))
	@touch $@

demo: $(VENV)/.ready
	@rm -rf out/demo
	$(BIN)/excite demo --out out/demo --jobs $(JOBS)

# Any warning is an error: a link that leads nowhere, a page that no other page names.
manual: $(VENV)/.ready
	$(BIN)/python -m sphinx -W --keep-going -q -b html -d out/manual/.doctrees docs out/manual
	@echo "out/manual/index.html"

# Each worker starts with a part of the tests that stand together, whose fixtures are then made once.
PYTEST := $(BIN)/python -m pytest -n $(JOBS) --dist worksteal

# A sample of each long battery; all of them, and the papers' tables, are in test-all.
test: $(VENV)/.ready
	$(PYTEST) -m "not battery"

test-fast: $(VENV)/.ready
	$(PYTEST) -m "not slow and not battery"

test-all: $(VENV)/.ready
	$(PYTEST)
	$(MAKE) reproduce

bench: $(VENV)/.ready
	$(BIN)/python -m tests.benchmarks

bench-all: $(VENV)/.ready
	$(BIN)/python -m tests.benchmarks --all

# Documents of commands on fixed inputs, beside those that were kept.
golden: $(VENV)/.ready
	$(BIN)/python -m tests.golden --jobs $(JOBS)

reproduce: $(VENV)/.ready
	$(BIN)/python -m tests.reproduction

lint: $(VENV)/.ready
	$(BIN)/ruff check . && $(BIN)/ruff format --check . && $(BIN)/mypy

format: $(VENV)/.ready
	$(BIN)/ruff format . && $(BIN)/ruff check --fix .

# Every night: half an hour.
PROBLEMS ?= 150000
check-properties: $(VENV)/.ready
	$(BIN)/python -m tests.properties --problems $(PROBLEMS)

FUZZ_SECONDS ?= 300
fuzz: $(VENV)/.ready
	$(BIN)/python -m tests.fuzz --seconds $(FUZZ_SECONDS)

licences: $(VENV)/.ready
	$(BIN)/python -m tests.supply

# Cosmic Ray has an environment of its own: what it needs is no business of the package's.
$(MUTATION)/.ready:
	$(PYTHON) -m venv --clear $(MUTATION)
	$(MUTATION)/bin/python -m pip install --quiet --disable-pip-version-check cosmic-ray==8.7.0
	@touch $@

mutation: $(VENV)/.ready $(MUTATION)/.ready
	PYTHONPATH=. $(MUTATION)/bin/python -m tests.mutation --python $(abspath $(BIN)/python)

report: $(VENV)/.ready
	$(BIN)/excite report out/demo

clean:
	rm -rf $(VENV) $(MUTATION) out build dist
