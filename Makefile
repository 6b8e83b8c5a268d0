# Two commands for a newcomer: `make demo` and `make test`.
PYTHON ?= python3
VENV ?= .venv
BIN := $(VENV)/bin
PIP := $(BIN)/python -m pip install --quiet --disable-pip-version-check

.PHONY: demo test test-browser test-readers test-slow lint docs wheel clean help

help:
	@echo "make demo         set up the base installation (no torch) and run the whole path on a generated clip"
	@echo "make test         set up the train and dev extras and run the tests"
	@echo "make test-browser the tests of pages in the system's Chromium"
	@echo "make test-readers CVAT's own reader opens what is exported, in an environment of its own"
	@echo "make test-slow    the tests that take over 2 seconds, after make test"
	@echo "make lint         ruff and mypy --strict"
	@echo "make docs         build the manual into out/site"
	@echo "make wheel        build the wheel and check what is in it"
	@echo "make clean        remove the virtual environment and all outputs"

demo: $(VENV)/.base
	$(BIN)/tsuiseki demo --out out/demo --overwrite

test: $(VENV)/.dev
	OMP_NUM_THREADS=1 $(BIN)/python -m pytest -n 2 --dist loadfile -m "not gpu and not slow and not browser"

test-browser: $(VENV)/.dev
	$(BIN)/python -m pytest -m browser tests

test-readers: $(VENV)/.dev $(VENV)/.readers
	$(BIN)/python -m pytest -rs tests/tracking/formats/test_readers.py

test-slow: $(VENV)/.dev
	OMP_NUM_THREADS=1 $(BIN)/python -m pytest -n 2 --dist loadfile -m "slow and not gpu and not browser"

lint: $(VENV)/.dev
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/mypy tests/typing/readme_calls.py

docs: $(VENV)/.docs
	NO_MKDOCS_2_WARNING=1 $(BIN)/python -m mkdocs build --strict
	@echo "open out/site/index.html"

wheel: $(VENV)/.dev
	$(BIN)/python .ci/check_wheel.py

clean:
	rm -rf $(VENV) out build dist *.egg-info

$(VENV)/.venv:
	$(PYTHON) -c "import sys; sys.exit(sys.version_info < (3, 11) and 'tsuiseki needs Python 3.11 or newer, found ' + sys.version.split()[0] + '; run make PYTHON=python3.11')"
	$(PYTHON) -m venv $(VENV)
	touch $@

$(VENV)/.base: $(VENV)/.venv pyproject.toml
	$(PIP) --editable .
	touch $@

$(VENV)/.dev: $(VENV)/.venv pyproject.toml
	$(PIP) --editable ".[train,dev]"
	touch $@ $(VENV)/.base

# datumaro needs an OpenCV below 5. Where it cannot be installed, its tests are skipped.
$(VENV)/.readers:
	-$(PYTHON) -m venv $(VENV)/readers && $(VENV)/readers/bin/python -m pip install --quiet datumaro
	touch $@

$(VENV)/.docs: $(VENV)/.venv pyproject.toml
	$(PIP) --editable ".[docs]"
	touch $@ $(VENV)/.base
