# `make play` and `make test` do all their set-up; `make help` lists the rest.
PYTHON ?= python3
VENV   := .venv
BIN    := $(VENV)/bin
STAMP  := $(VENV)/.installed
PORT   ?= 8000

.DEFAULT_GOAL := help
.PHONY: help play test test-long check format bench clean browser

help: ## list the targets
	@grep -hE '^[a-z-]+:.*## ' $(MAKEFILE_LIST) | sed -E 's/:[^#]*## /\t/' | expand -t 14

play: $(STAMP) ## serve the playground on http://127.0.0.1:8000 (PORT=... for another)
	$(BIN)/marsexplorer serve --port $(PORT)

test: $(STAMP) browser ## all tests but the long campaigns, real browser included
	$(BIN)/python -m pytest -m "not long and not bench"

test-long: $(STAMP) browser ## the slow campaigns
	$(BIN)/python -m pytest -m long --timeout 3600

bench: $(STAMP) browser ## benchmarks: absolute times reported, ratios of one run gated
	$(BIN)/python -m pytest -m bench -s -p no:cacheprovider --timeout 3600

check: $(STAMP) ## format, lint, types (the module-import rules are a test: tests/test_architecture.py)
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/mypy
	@sh tests/static/check_types.sh
	$(BIN)/python -m pytest -q tests/test_architecture.py

format: $(STAMP) ## reformat and mend what ruff can mend
	$(BIN)/ruff format .
	$(BIN)/ruff check --fix .

browser: ## Chromium (browser tests) and nginx (proxy test) from Debian's packages, where they can be had
	@sh tests/browser/install_browser.sh

$(STAMP): pyproject.toml constraints.txt
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || { echo "Python 3.11 or newer is needed; name it: make PYTHON=/path/to/python3.11" >&2; exit 1; }
	@$(PYTHON) -c 'import ensurepip' 2>/dev/null || { echo "installing python3-venv"; apt-get update -qq && apt-get install -y -qq python3-venv; }
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --constraint constraints.txt --editable '.[dev]'
	@touch $@

clean: ## remove the virtual environment and caches (never data/)
	rm -rf $(VENV) .mypy_cache .ruff_cache .pytest_cache .hypothesis build dist
