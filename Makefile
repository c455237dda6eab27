# Two commands on a fresh machine: `make demo` and `make test`. Each does all of its own set-up.
PYTHON ?= python3
VENV   := .venv
BIN    := $(VENV)/bin
# Python compiles the few modules that are used when it imports them; pip would compile all of them, for half of its time.
PIP    := -m pip install --quiet --no-compile --disable-pip-version-check
# Many processes start here; each of them would compile the sources anew where an environment says that bytecode is not written.
export PYTHONDONTWRITEBYTECODE :=
CORE   := $(VENV)/.core
READY  := $(VENV)/.ready

.PHONY: demo browser ros warm test check lint docs tests nightly bounds plain clean

$(CORE): pyproject.toml
	@test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	@echo "installing antway into $(VENV) ..."
	@$(BIN)/python $(PIP) --editable .
	@touch $@

$(READY): $(CORE)
	@echo "installing the development tools into $(VENV) ..."
	@$(BIN)/python $(PIP) --editable '.[web,arena,bags,docs,dev]'
	@touch $@

demo: $(CORE)
	@$(BIN)/antway demo --out demo

# The tests of pages drive Debian's Chromium; it is installed here where that is possible, and missed aloud where it is not.
browser:
	@command -v chromium >/dev/null \
	|| { test "$$(id -u)" = 0 && command -v apt-get >/dev/null && echo "installing chromium for the tests of pages ..." \
	     && apt-get update -qq >/dev/null 2>&1 \
	     && DEBIAN_FRONTEND=noninteractive apt-get install -qq -y --no-install-recommends chromium >/dev/null 2>&1; } \
	|| echo "no chromium, and no root with apt-get and a network to install it: the tests of pages will be skipped"

# Real ROS 2 comes as wheels, which re-exec Python: they have an environment of their own.
ROS := ros-rclpy[fastrtps]==9.1.2 ros-nav-msgs ros-sensor-msgs ros-geometry-msgs ros-std-srvs ros-visualization-msgs \
       ros-diagnostic-msgs ros-rosgraph-msgs ros-test-msgs

ros:
	@test "$$(cat .venv-ros/bin/.ready 2>/dev/null)" = "$(ROS)" \
	|| { echo "installing ROS 2 into .venv-ros for its tests ..." && $(PYTHON) -m venv .venv-ros \
	     && .venv-ros/bin/python $(PIP) $(patsubst %,'%',$(ROS)) --editable . 2>/dev/null \
	     && echo "$(ROS)" > .venv-ros/bin/.ready; } \
	|| echo "no ROS 2 wheels for this machine, or no network: the tests of the ROS 2 node will be skipped"

check: lint docs

lint: $(READY)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports

docs: $(READY)
	nice $(BIN)/python -m sphinx -W --keep-going -q -b html docs build/docs

# Kernels that are compiled before the tests are compiled once, not by each of two processes that need them. They are compiled
# from src, because the development tools, which are installed meanwhile, replace the installed package for a moment.
warm: $(CORE)
	@PYTHONPATH=src $(BIN)/python -m antway warmup

# What the tests need is installed and compiled side by side, and the code is checked beside that, the documentation beside the
# tests, so that no core has nothing to do.
test:
	@$(MAKE) --no-print-directory -j4 warm browser ros lint
	@$(MAKE) --no-print-directory -j2 docs tests

# Three workers on two cores: many tests wait for processes, pages and sockets, but a fourth made it no shorter. conftest.py says
# which files begin, and which give way.
tests: $(READY)
	$(BIN)/python -m pytest -n 3 --dist loadfile --no-loadscope-reorder -rs

nightly: $(READY) browser ros
	ANTWAY_TEST_SCALE=100 $(BIN)/python -m pytest -n 2 --dist loadfile -rs

# The whole suite with every index of every kernel checked, and with kernels as plain Python, which takes hours.
bounds: $(READY)
	NUMBA_BOUNDSCHECK=1 NUMBA_CACHE_DIR=$(VENV)/.bounds $(BIN)/python -m pytest -n 2 --dist loadfile -rs --timeout 3600

plain: $(READY)
	NUMBA_DISABLE_JIT=1 $(BIN)/python -m pytest -n 2 --dist loadfile -rs --timeout 3600 \
	    -W "ignore:overflow encountered:RuntimeWarning"

clean:
	rm -rf $(VENV) .venv-ros demo
	find src -name '*.nb[ic]' -delete
