# `make play` and `make test` do all their set-up; `make help` lists the rest.
PYTHON  ?= python3
PORT    ?= 8000
# two test processes more than there are cores, since many tests wait; four at most
WORKERS ?= $(shell $(PYTHON) -c 'import os; print(min(4, 2 + os.cpu_count()))')
VENV    := .venv
BIN     := $(VENV)/bin
PLAY    := $(VENV)/.play
DEV     := $(VENV)/.dev
AUDIT   := $(VENV)/.audit
SBOM    := dist/humanplay.cdx.json
# tianshou wants an older pandas than the rest, so research has an environment of its own
RESEARCH := .venv-research
# and so have the clients that other people's agents use
AGENTS  := .venv-agents
# the generator of the API's clients wants an older typer than ours
CLIENT  := .venv-client
# extras whose packages are installed by their hashes; PyTorch's, of the others, differ by machine
HASHED  := mars play study export analysis onnx video docs audit
PIP     := -m pip --disable-pip-version-check install --progress-bar on
INSTALL := $(BIN)/python $(PIP) --constraint constraints.txt --editable

# a test run starts some hundred processes, and each would compile the whole app again
unexport PYTHONDONTWRITEBYTECODE

.DEFAULT_GOAL := help
.PHONY: help play agents client test test-long cards paper tables test-research check check-types check-rest format docs texts bench audit requirements sbom dist clean browser

help: ## list the targets
	@grep -hE '^[a-z-]+:.*## ' $(MAKEFILE_LIST) | sed -E 's/:[^#]*## /\t/' | expand -t 14

play: $(PLAY) ## serve the playground on http://127.0.0.1:8000 (PORT=... for another)
	$(BIN)/humanplay serve --port $(PORT)

agents: $(AGENTS)/.done ## what the agents in examples/agents need, in an environment of its own (docs/agents.md)

client: $(CLIENT)/.done ## the generator whose client of the API a test plays with, in an environment of its own

test: $(DEV) browser ## all tests but the long campaigns, real browser included (WORKERS=... for fewer processes)
	@$(MAKE) --no-print-directory client || echo "NO GENERATOR of clients could be installed: its test is skipped" >&2
	@$(BIN)/python -m marsexplorer.warmup
	$(BIN)/python -m pytest -m "not long and not bench and not alone" -n $(WORKERS) --dist worksteal
	$(BIN)/python -m pytest -m alone $$(grep -rl --include='test_*.py' 'mark\.alone' tests)

test-long: $(DEV) browser ## the slow campaigns
	$(BIN)/python -m pytest -m long --timeout 3600

cards: $(DEV) ## play every episode that the cards of shipped policies list, move for move (`make test` plays ten of each)
	$(BIN)/python -m pytest -m long --timeout 3600 tests/marsexplorer/policies/test_cards.py

tables: $(DEV) ## draw the documents' tables, and the page's types of what is answered, again from the code
	$(BIN)/python docs/draw_tables.py

texts: $(DEV) ## draw the catalogues of what participants read again from the code, and compile the translations
	$(BIN)/python docs/draw_catalogues.py

paper: $(RESEARCH)/.done ## what the paper's four algorithms need, in an environment of its own; then draw docs/paper.md again
	$(RESEARCH)/bin/python -m research.paper.claims.page
	@echo "Next: $(RESEARCH)/bin/python -m research.paper --figure 4 --budget small   (--help lists the rest)"

test-research: $(RESEARCH)/.done $(DEV) ## the tests of research/: paper and tuning in its own environment
	$(RESEARCH)/bin/python -m pytest research/paper research/tuning -m "not long and not bench"
	$(BIN)/python -m pytest research -m "not long and not bench" --ignore research/paper --ignore research/tuning

bench: $(DEV) browser ## benchmarks: absolute times reported, ratios of one run gated
	$(BIN)/python -m pytest tests research -m bench -s -p no:cacheprovider --timeout 3600

check: $(DEV) ## format, lint, types and layers
	@$(MAKE) --no-print-directory --jobs 2 check-types check-rest

check-types:
	$(BIN)/mypy

check-rest:
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	@sh tests/static/check_types.sh
	$(BIN)/lint-imports

audit: $(AUDIT) ## known vulnerabilities in the packages of constraints.txt (asks an advisory service, so it is no part of `make check`)
	$(BIN)/pip-audit --strict --no-deps --disable-pip --requirement constraints.txt

requirements: $(AUDIT) ## what each extra installs, pinned as in constraints.txt and with its hashes, in requirements/
	for extra in $(HASHED); do \
	    $(BIN)/uv pip compile pyproject.toml --quiet --extra $$extra --constraint constraints.txt --generate-hashes \
	        --universal --python-version 3.11 --no-header --no-annotate --no-emit-package pip \
	        --output-file requirements/$$extra.txt >/dev/null || exit 1; \
	done

sbom: $(AUDIT) ## the packages of constraints.txt as a CycloneDX bill of materials, to publish beside a release
	@mkdir -p dist
	PYTHONWARNINGS=ignore $(BIN)/cyclonedx-py requirements constraints.txt --pyproject pyproject.toml --output-reproducible --of JSON -o $(SBOM)
	@echo "$(SBOM) lists what is installed beside this release"

dist: $(AUDIT) ## wheel and source distribution in dist/, checked by twine
	rm -f dist/*.whl dist/*.tar.gz
	$(BIN)/python -m build
	$(BIN)/twine check --strict dist/*.whl dist/*.tar.gz

format: $(DEV) ## reformat and mend what ruff can mend
	$(BIN)/ruff format .
	$(BIN)/ruff check --fix .

docs: $(DEV) ## the documentation as a site, in build/site (open build/site/index.html)
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict

browser: ## Chromium (browser tests) and nginx (proxy test) from Debian's packages, where they can be had
	@sh tests/browser/install_browser.sh

$(BIN)/python:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || { echo "Python 3.11 or newer is needed; name it: make PYTHON=/path/to/python3.11" >&2; exit 1; }
	@$(PYTHON) -c 'import ensurepip' 2>/dev/null || { echo "installing python3-venv"; apt-get update -qq && apt-get install -y -qq python3-venv; }
	$(PYTHON) -m venv $(VENV)

$(PLAY): pyproject.toml requirements/play.txt | $(BIN)/python
	@echo "Installing what playing needs into $(VENV): about 0.5 GB, some minutes when nothing has been downloaded before."
	$(BIN)/python $(PIP) --require-hashes --requirement requirements/play.txt
	$(BIN)/python $(PIP) --no-deps --editable .
	@touch $@

$(DEV): pyproject.toml constraints.txt | $(BIN)/python
	@echo "Installing what tests and checks need into $(VENV): about 2 GB, some minutes when nothing has been downloaded before."
	$(INSTALL) '.[dev]'
	@touch $@ $(PLAY)

$(AUDIT): pyproject.toml constraints.txt | $(BIN)/python
	$(INSTALL) '.[audit]'
	@touch $@

$(RESEARCH)/.done: pyproject.toml research/requirements.txt research/constraints.txt
	@$(MAKE) --no-print-directory VENV=$(RESEARCH) $(RESEARCH)/bin/python
	@echo "Installing what research needs into $(RESEARCH): about 1.5 GB, some minutes when nothing has been downloaded before."
	$(RESEARCH)/bin/python $(PIP) --constraint research/constraints.txt --requirement research/requirements.txt --editable '.[study,train]'
	@touch $@

$(AGENTS)/.done: pyproject.toml
	@$(MAKE) --no-print-directory VENV=$(AGENTS) $(AGENTS)/bin/python
	@echo "Installing what agents need into $(AGENTS): some minutes when nothing has been downloaded before."
	$(AGENTS)/bin/python $(PIP) --editable '.[agents]'
	@touch $@

$(CLIENT)/.done:
	@$(MAKE) --no-print-directory VENV=$(CLIENT) $(CLIENT)/bin/python
	$(CLIENT)/bin/python $(PIP) openapi-python-client==0.29.1
	@touch $@

clean: ## remove the virtual environments and caches (never data/)
	rm -rf $(VENV) $(RESEARCH) $(AGENTS) $(CLIENT) .mypy_cache .ruff_cache .pytest_cache .hypothesis build dist
