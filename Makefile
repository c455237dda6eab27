# Two commands on a fresh machine: `make demo` and `make test`. Each does all of its own set-up.
PYTHON ?= python3
VENV   := .venv
BIN    := $(VENV)/bin
READY  := $(VENV)/.ready

.PHONY: demo test check nightly clean

$(READY): pyproject.toml
	@test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	@echo "installing antway and its development tools into $(VENV) ..."
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable '.[web,smooth,dev]'
	@touch $@

demo: $(READY)
	@$(BIN)/antway demo --out demo

check: $(READY)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports

test: $(READY) check
	$(BIN)/python -m pytest -n 2 --dist loadfile -rs

nightly: $(READY)
	ANTWAY_TEST_SCALE=100 $(BIN)/python -m pytest -n 2 --dist loadfile -rs

clean:
	rm -rf $(VENV) .venv-ros demo
