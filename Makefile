# make demo   runs the main job on input that ships with the project
# make test   runs the tests
# make lint   checks types and style
# make lock   resolves the dependencies anew
# Each makes its own environment in .venv; Python 3.11 or newer and make are all that is needed.

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
READY := $(VENV)/ready

.PHONY: demo test lint lock clean

demo: $(READY)
	@$(BIN)/python pipelines/demo.py

test: $(READY)
	@$(BIN)/python -m pytest -q -n auto --dist loadfile

lint: $(READY)
	@$(BIN)/ruff check .
	@$(BIN)/ruff format --check .
	@$(BIN)/mypy

$(READY): requirements.lock pyproject.toml
	@$(PYTHON) -c 'import sys; sys.exit("streamkit needs Python 3.11 or newer, this is " + sys.version.split()[0] + "; set PYTHON=...") if sys.version_info < (3, 11) else None'
	@echo "making the environment in $(VENV); this takes some minutes, and happens once"
	@$(PYTHON) -m venv $(VENV)
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check --require-hashes --requirement requirements.lock
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-deps --no-build-isolation --editable .
	@$(BIN)/streamkit prepare
	@touch $@

lock:
	@$(PYTHON) -m venv $(VENV)-lock
	@$(VENV)-lock/bin/python -m pip install --quiet --disable-pip-version-check "uv>=0.9,<1"
	@$(VENV)-lock/bin/uv pip compile pyproject.toml --extra dev --generate-hashes --no-emit-index-url \
	    --no-header --no-annotate --python-version 3.11 --upgrade --quiet --output-file requirements.lock

clean:
	@rm -rf $(VENV) $(VENV)-lock out
	@find plugins -name "*.nb[ci]" -delete
