# One environment in .venv; nothing else to set up than Python 3.11+ with venv, and make.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
PHOTO ?=
EXTRAS := cpu,linker,demo

.PHONY: demo test test-all lint docs site site-serve golden benchmark plugin extension blender clean

demo: $(VENV)/demo
	@$(BIN)/python -m tools.device
	$(BIN)/python -m tools.demo $(if $(PHOTO),--photo "$(PHOTO)")

test: $(VENV)/test
	@$(BIN)/python -m tools.device
	$(BIN)/python -m pytest -n 2 -m "not slow"

test-all: $(VENV)/test  # with the slow sweeps
	@$(BIN)/python -m tools.device
	$(BIN)/python -m pytest -n 2

lint: $(VENV)/test
	$(BIN)/python -m pip install -qq -e ".[lint]"
	$(BIN)/ruff check . && $(BIN)/ruff format --check . && $(BIN)/mypy

docs: $(VENV)/demo  # pages from the declarations, and the pictures in them
	$(BIN)/python -m tools.docs.pages
	$(BIN)/python -m tools.docs.pictures

site: $(VENV)/site  # the docs with search, into site/: open site/index.html
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict --quiet
	@echo "open site/index.html"

site-serve: $(VENV)/site  # the same, renewed while you write
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs serve

plugin: $(VENV)/demo  # by which OpenImageIO opens .oiiotex files: docs/how-to/hosts.md
	$(BIN)/python hosts/openimageio/build.py

golden: $(VENV)/test  # renew the golden images: look at them before you commit
	$(BIN)/python -m tests.golden

extension:  # of Blender, one zip: docs/how-to/hosts.md
	$(PYTHON) hosts/blender/build.py oiiotex_blender.zip

blender: $(VENV)/blender/made  # an environment of its own (bpy pins an older NumPy), in which Blender's tests run

$(VENV)/blender/made: $(VENV)/checked
	$(PYTHON) -m venv $(VENV)/blender
	$(VENV)/blender/bin/python -m pip install -qq "bpy>=4.2"
	@touch $@

benchmark: $(VENV)/test  # and renew their tables: benchmarks/README.md
	$(BIN)/python -m pip install -qq -e ".[benchmark]"
	$(BIN)/python -m benchmarks speed
	$(BIN)/python -m benchmarks tiles tune
	$(BIN)/python -m benchmarks multiscale windows
	$(BIN)/python -m benchmarks kernels

clean:
	rm -rf $(VENV) demo-out build site *.egg-info

$(VENV)/checked:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null || \
	  { echo "oiiotex needs Python 3.11 or newer as '$(PYTHON)'; name another with make PYTHON=python3.12"; exit 1; }
	@$(PYTHON) -c 'import venv, ensurepip' 2>/dev/null || \
	  { echo "this Python has no venv: install it (Debian: apt install python3-venv)"; exit 1; }
	@$(PYTHON) -m venv $(VENV)
	@$(BIN)/python -m pip install -qq --upgrade pip
	@touch $@

$(VENV)/demo: $(VENV)/checked pyproject.toml
	$(BIN)/python -m pip install -qq -e ".[$(EXTRAS)]"
	@touch $@

$(VENV)/site: $(VENV)/checked pyproject.toml
	$(BIN)/python -m pip install -qq -e ".[site]"
	@touch $@

$(VENV)/test: $(VENV)/demo pyproject.toml
	$(BIN)/python -m pip install -qq -e ".[$(EXTRAS),test]"
	@touch $@
