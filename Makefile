# Needs make and Python 3.11 or newer. Everything else is installed into .venv, again whenever pyproject.toml changes.

VENV := .venv
BIN := $(VENV)/bin
JOBS ?= 2

CANDIDATES := python3 python3.14 python3.13 python3.12 python3.11 python
NEW_ENOUGH := import sys; sys.exit(sys.version_info < (3, 11))
PYTHON ?= $(shell for p in $(CANDIDATES); do $$p -c '$(NEW_ENOUGH)' >/dev/null 2>&1 && echo $$p && break; done)
INSTALL := $(BIN)/python -m pip install -qq --no-compile --no-input --disable-pip-version-check --progress-bar off

# what the tests of a file share is made, and what they compile is compiled, by one worker; tests/conftest.py orders the files
PARALLEL := -n $(JOBS) --dist loadfile --no-loadscope-reorder

export PYRIGHT_PYTHON_IGNORE_WARNINGS := 1
# tests, pages and the demo start many processes: what they import is compiled once, whatever the caller has set
unexport PYTHONDONTWRITEBYTECODE

.PHONY: help demo docs test test-fast package lint bench clean
.NOTPARALLEL:

help:
	@echo "make demo       the published motions, a film and a diagnosis, and a page that leads to them, into out/demo"
	@echo "make docs       the documentation site, into out/site; its pages run"
	@echo "make test       every test but the longest; DRILLENV_THOROUGH=1 adds them"
	@echo "make test-fast  the tests that take a second at most"
	@echo "make package    wheel and sdist, checked, and the wheel tried in empty environments"
	@echo "make lint       ruff and pyright"
	@echo "make bench      what is faster than what, measured here"
	@echo "make clean      remove what was installed, cached and built"

demo: $(VENV)/base.stamp
	@$(BIN)/drillenv demo --out out/demo

# pages run where the code has changed since they last did; out/docs-cache keeps what they gave
docs: export OPENBLAS_NUM_THREADS = 1
docs: $(VENV)/dev.stamp
	@$(BIN)/sphinx-build --fail-on-warning --keep-going --fresh-env --quiet docs out/site
	@echo "open out/site/index.html"

# each worker has a core: threads of linear algebra would only get into each other's way
test test-fast: export OPENBLAS_NUM_THREADS = 1
# policies are played in single precision; the kernels of other processors round otherwise, which a motion close to chaos
# shows: the league was recorded with these
test test-fast: export OPENBLAS_CORETYPE = Haswell

test: $(VENV)/dev.stamp
	@$(BIN)/pytest $(PARALLEL)

test-fast: $(VENV)/dev.stamp
	@$(BIN)/pytest $(PARALLEL) -m "not slow"

package: $(VENV)/dev.stamp
	@DRILLENV_THOROUGH=1 $(BIN)/pytest tests/test_package.py

lint: $(VENV)/dev.stamp
	@$(BIN)/ruff check .
	@$(BIN)/ruff format --check .
	@$(BIN)/pyright --threads $(JOBS)

bench: $(VENV)/dev.stamp
	@$(BIN)/python -m benchmarks.speed
	@$(BIN)/python -m benchmarks.batch

clean:
	rm -rf $(VENV) out/demo out/site out/jupyter_execute out/docs-cache build dist *.egg-info .pytest_cache .ruff_cache .hypothesis
	find . -name __pycache__ -type d -prune -exec rm -rf {} +

$(VENV)/created.stamp:
	@test -n "$(PYTHON)" || { echo "make: found no Python 3.11 or newer; name one: make PYTHON=/path/to/python3" >&2; exit 1; }
	@echo "Setting up $(VENV) with $$($(PYTHON) --version)"
	@$(PYTHON) -m venv $(VENV)
	@touch $@

# make demo needs only what drillenv itself imports, and what plays a policy.
$(VENV)/base.stamp: pyproject.toml $(VENV)/created.stamp
	@echo "Installing drillenv into $(VENV) (a few minutes the first time)"
	@$(INSTALL) -e ".[controllers]"
	@touch $@

$(VENV)/dev.stamp: pyproject.toml $(VENV)/created.stamp
	@echo "Installing drillenv and its development tools into $(VENV) (a few minutes the first time)"
	@$(INSTALL) -e ".[dev]"
	@touch $(VENV)/base.stamp $@
