# make demo   runs the main job on input that ships with the project
# make test   runs the tests
# make lint   checks types and style
# make docs   builds the documentation into site/, with warnings as errors
# make wheel  builds the wheel into dist/, and tries it in a fresh environment
# make lock   resolves the dependencies anew
# Each makes its own environment (.venv, .venv-docs, ...); Python 3.11 or newer and make are all that is needed.

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
READY := $(VENV)/ready
PIP := python -m pip --quiet --disable-pip-version-check

.PHONY: demo test lint docs wheel lock clean

demo: $(READY)
	@$(BIN)/python pipelines/demo.py

# Python may cache: each worker would compile all tests again. One process compiles them beforehand. Tests wait for
# half of their time, for servers and clocks: on two cores six workers are busy.
test: $(READY)
	@$(BIN)/python -m compileall -q streamkit plugins  # for the processes that tests start
	@PYTHONDONTWRITEBYTECODE= $(BIN)/python -m pytest -q --collect-only > /dev/null || true
	@PYTHONDONTWRITEBYTECODE= $(BIN)/python -m pytest -q -n 6 --dist loadfile --no-loadscope-reorder

lint: $(READY)
	@$(BIN)/ruff check .
	@$(BIN)/ruff format --check .
	@$(BIN)/mypy
	@$(BIN)/mypy --config-file benchmarks/mypy.ini --cache-dir .mypy_cache/benchmarks

docs: $(VENV)-docs/ready
	@NO_MKDOCS_2_WARNING=1 $(VENV)-docs/bin/mkdocs build --strict
	@echo "open site/index.html"

# The wheel's own dependencies, in the versions of the lock, and nothing else: a missing one shows.
wheel: $(READY)
	@rm -rf dist $(VENV)-wheel
	@$(BIN)/$(PIP) wheel --no-deps --no-build-isolation --wheel-dir dist .
	@$(PYTHON) -m venv $(VENV)-wheel
	@sed -n 's/^\([A-Za-z0-9._-]*==[^ ]*\).*/\1/p' requirements.lock > $(VENV)-wheel/versions.txt
	@$(VENV)-wheel/bin/$(PIP) install --constraint $(VENV)-wheel/versions.txt dist/streamkit-*.whl
	@$(VENV)-wheel/bin/$(PIP) check
	@streamkit=$(CURDIR)/$(VENV)-wheel/bin/streamkit; folder=$$(mktemp -d) && trap "rm -rf $$folder" EXIT && cd $$folder \
	    && $$streamkit launch -q "videotestsrc num-buffers=5 ! fakesink" \
	    && $$streamkit inspect > elements.txt && $$streamkit inspect particletrack > /dev/null \
	    && $$streamkit new smoke-test > /dev/null && test -f smoke-test/pyproject.toml \
	    && echo "the wheel works by itself, with $$(wc -l < elements.txt) elements"

$(READY): requirements.lock pyproject.toml
	@$(PYTHON) -c 'import sys; sys.exit("streamkit needs Python 3.11 or newer, this is " + sys.version.split()[0] + "; set PYTHON=...") if sys.version_info < (3, 11) else None'
	@echo "making the environment in $(VENV); this takes some minutes, and happens once"
	@$(PYTHON) -m venv $(VENV)
	@$(BIN)/$(PIP) install --require-hashes --requirement requirements.lock
	@$(BIN)/$(PIP) install --no-deps --no-build-isolation --editable .
	@$(BIN)/python -m compileall -q streamkit plugins
	@$(BIN)/streamkit prepare
	@touch $@

$(VENV)-docs/ready: requirements-docs.lock
	@$(PYTHON) -m venv $(VENV)-docs
	@$(VENV)-docs/bin/$(PIP) install --require-hashes --requirement requirements-docs.lock
	@touch $@

lock:
	@$(PYTHON) -m venv $(VENV)-lock
	@$(VENV)-lock/bin/$(PIP) install "uv>=0.9,<1"
	@$(VENV)-lock/bin/uv pip compile pyproject.toml --extra dev --generate-hashes --no-emit-index-url \
	    --no-header --no-annotate --python-version 3.11 --upgrade --quiet --output-file requirements.lock
	@$(VENV)-lock/bin/uv pip compile --group docs --generate-hashes --no-emit-index-url \
	    --no-header --no-annotate --python-version 3.11 --upgrade --quiet --output-file requirements-docs.lock

clean:
	@rm -rf $(VENV) $(VENV)-docs $(VENV)-lock $(VENV)-wheel out site dist
	@find plugins -name "*.nb[ci]" -delete
