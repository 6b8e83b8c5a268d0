# Two commands for a newcomer: `make demo` and `make test`.
PYTHON ?= python3
VENV ?= .venv
# Thousands of short runs would compile everything anew.
unexport PYTHONDONTWRITEBYTECODE
BIN := $(VENV)/bin
PIP := $(BIN)/python -m pip install --quiet --disable-pip-version-check
LOWEST := $(VENV)/lowest
NOTEBOOKS := $(patsubst docs/%,out/%,$(wildcard docs/notebooks/*.ipynb))
# Readers, writers and methods that lean on other packages most; none needs torch.
SAMPLE := $(addprefix tests/tracking/,test_geometry.py test_onnx.py test_result.py association counts/test_counting.py \
	filters openers video) $(filter-out %/test_box_labels.py,$(wildcard tests/tracking/formats/test_*.py))

.PHONY: demo test test-browser test-readers test-slow test-lowest benchmarks audit lock lint docs wheel release clean help

help:
	@echo "make demo         set up the base installation (no torch) and run the whole path on a generated clip"
	@echo "make test         set up the train and dev extras and run the tests"
	@echo "make test-browser the tests of pages in the system's Chromium"
	@echo "make test-readers CVAT's own reader opens what is exported, in an environment of its own"
	@echo "make test-slow    the tests that take over a second, after make test"
	@echo "make test-lowest  the demo and a sample of the tests with the lowest versions that pyproject.toml allows"
	@echo "make benchmarks   the smallest rows of the table of speeds, with the peers that are installed"
	@echo "make audit        the locked packages against the index of advisories, where it can be reached"
	@echo "make lock         write requirements.lock anew: versions and hashes for contributors"
	@echo "make lint         ruff and mypy --strict"
	@echo "make docs         build the manual into out/site"
	@echo "make wheel        build the wheel and check what is in it"
	@echo "make release      VERSION=1.2.3: version, changelog, checks, wheel, bill of materials, commit and tag"
	@echo "make clean        remove the virtual environment and all outputs"

demo: $(VENV)/.base
	$(BIN)/tsuiseki demo --out out/demo --overwrite

test: $(VENV)/.dev
	OMP_NUM_THREADS=1 $(BIN)/python -m pytest -n 2 --dist loadfile --max-worker-restart 0 -m "not gpu and not slow and not browser"

test-browser: $(VENV)/.dev
	$(BIN)/python -m pytest -m browser tests

test-readers: $(VENV)/.dev $(VENV)/.readers
	$(BIN)/python -m pytest -rs tests/tracking/formats/test_readers.py

test-slow: $(VENV)/.dev
	OMP_NUM_THREADS=1 $(BIN)/python -m pytest -n 2 --dist worksteal --max-worker-restart 0 --durations 40 -m "slow and not paced and not gpu and not browser"
	OMP_NUM_THREADS=1 $(BIN)/python -m pytest -m paced tests

# Without torch: what trains has its own lower bounds.
test-lowest: $(LOWEST)/.made
	$(LOWEST)/bin/tsuiseki demo --out out/demo-lowest --overwrite
	OMP_NUM_THREADS=1 $(LOWEST)/bin/python -m pytest -q -m "not gpu and not slow and not browser and not integration" $(SAMPLE)

benchmarks: $(VENV)/.dev
	OMP_NUM_THREADS=1 $(BIN)/python -m benchmarks.all --small

audit: $(VENV)/.audit
	$(VENV)/audit/bin/python .ci/audit.py

lock: $(VENV)/.dev
	$(BIN)/python .ci/lock.py

lint: $(VENV)/.dev
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/mypy tests/typing/readme_calls.py

docs: $(VENV)/.docs
	OMP_NUM_THREADS=1 $(MAKE) --no-print-directory -j 2 $(NOTEBOOKS)
	NO_MKDOCS_2_WARNING=1 $(BIN)/python -m mkdocs build --strict
	@echo "open out/site/index.html"

# Executed in a folder of its own, with the commands of this environment.
out/notebooks/%.ipynb: docs/notebooks/%.ipynb
	rm -rf $(@D)/$* && mkdir -p $(@D)/$* && cp $< $(@D)/$*/
	cd $(@D)/$* && PATH="$(abspath $(BIN)):$$PATH" jupyter-nbconvert --log-level WARN --to notebook --execute --output ../$*.ipynb $*.ipynb

wheel: $(VENV)/.dev
	$(BIN)/python .ci/check_wheel.py

release: $(VENV)/.dev $(VENV)/.release
	$(BIN)/python .ci/release.py $(VERSION)

clean:
	rm -rf $(VENV) out build dist *.egg-info

$(VENV)/.venv:
	$(PYTHON) -c "import sys; sys.exit(sys.version_info < (3, 11) and 'tsuiseki needs Python 3.11 or newer, found ' + sys.version.split()[0] + '; run make PYTHON=python3.11')"
	$(PYTHON) -m venv $(VENV)
	touch $@

$(VENV)/.base: $(VENV)/.venv pyproject.toml
	$(PIP) --editable .
	touch $@

# trackeval asks for opencv-python, which lies in the place of the headless one. They differ in windows, which nothing
# here opens, and in the system's libGL, which only that one needs.
$(VENV)/.dev: $(VENV)/.venv pyproject.toml
	$(PIP) --editable ".[train,dev]"
	$(PIP) --no-deps "trackeval>=1.3"
	touch $@ $(VENV)/.base

$(LOWEST)/.made: pyproject.toml .ci/lowest.py
	$(PYTHON) -m venv --clear $(LOWEST)
	$(PYTHON) .ci/lowest.py train hdf5 tables > $(LOWEST)/constraints.txt
	$(LOWEST)/bin/python -m pip install --quiet --disable-pip-version-check --constraint $(LOWEST)/constraints.txt \
		--editable ".[hdf5,tables]" onnx pytest pytest-timeout
	touch $@

$(VENV)/.audit: $(VENV)/.venv
	-$(PYTHON) -m venv $(VENV)/audit && $(VENV)/audit/bin/python -m pip install --quiet --disable-pip-version-check pip-audit
	touch $@

$(VENV)/.release: $(VENV)/.dev
	$(PIP) "cyclonedx-bom>=7"
	touch $@

# datumaro needs an OpenCV below 5. Where it cannot be installed, its tests are skipped.
$(VENV)/.readers:
	-$(PYTHON) -m venv $(VENV)/readers && $(VENV)/readers/bin/python -m pip install --quiet datumaro
	touch $@

$(VENV)/.docs: $(VENV)/.venv pyproject.toml
	$(PIP) --editable ".[docs,train]"
	touch $@ $(VENV)/.base
