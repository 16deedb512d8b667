# `make demo` and `make test` set up what they need: a virtual environment in .venv, made anew when pyproject.toml changes.
# Another interpreter: make PYTHON=/path/to/python3.12 test. Other extras: make EXTRAS=dev,cluster test, after `make clean`.

VENV := .venv
EXTRAS := dev
BIN := $(VENV)/bin
READY := $(VENV)/.ready
FAST := build/fast
DOCS := build/docs-env

# Where it is set, every worker and every `artemis` that the tests start would compile everything again.
unexport PYTHONDONTWRITEBYTECODE

.PHONY: demo test test-ci late test-all check fast fast-equals-plain bench bench-fast bench-followers host-death campaign campaigns coverage core-coverage mutation fuzz picture page-pictures thesis docs wheel clean

demo: $(READY)
	@$(BIN)/artemis run missions/figure_eight.yaml

test: $(READY)
	@$(BIN)/python -m pytest; status=$$?; $(MAKE) --no-print-directory late && exit $$status

test-ci: $(READY)
	@$(BIN)/python -m pytest -m "not exhaustive or programs" --left; status=$$?; $(MAKE) --no-print-directory late && exit $$status

# What failed in real time beside other tests has to pass alone.
late: $(READY)
	@for try in 1 2 3; do $(BIN)/python -m pytest -n 0 -m "" --late && exit 0; done; exit 1

test-all: $(READY)
	@$(BIN)/python -m pytest -m "" --hypothesis-profile=exhaustive; status=$$?; $(MAKE) --no-print-directory late && exit $$status

check: $(READY)
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/mypy
	$(BIN)/lint-imports --no-cache

fast: $(FAST)/.ready
	@$(FAST)/bin/artemis --version

fast-equals-plain: $(READY) $(FAST)/.ready
	@$(BIN)/python -m tests.same --seeds $(or $(SEEDS),200)

bench: $(READY)
	@$(BIN)/python -m tests.bench --write

bench-fast: $(FAST)/.ready
	@PYTHONSAFEPATH=1 $(FAST)/bin/python -m tests.bench --write

bench-followers: $(READY)
	@$(BIN)/artemis bench followers --output build/bench-followers $(if $(PYTHON_ROBOTICS),--python-robotics $(PYTHON_ROBOTICS))

host-death: $(READY)
	@$(BIN)/python -m tests.host_death --cases 200

campaign: $(READY)
	@$(BIN)/artemis campaign missions/campaigns/everything.yaml

campaigns: $(READY)
	@failed=0; for robot in absolute cia402 epos4 rear_driven small_car small_car_switch tricycle; do \
		$(BIN)/artemis campaign missions/campaigns/$$robot.yaml || failed=1; \
	done; exit $$failed

coverage: $(READY)
	@$(BIN)/coverage erase
	@$(BIN)/coverage run -m pytest; status=$$?; \
	$(BIN)/coverage combine --quiet && $(BIN)/coverage report && exit $$status

core-coverage: $(READY)
	@$(BIN)/python -m tests.mutation.coverage

mutation: $(READY)
	@$(BIN)/python -m tests.mutation

fuzz: $(READY)
	@$(BIN)/python -m tests.fuzz --seconds $(or $(SECONDS),60)

picture: $(READY)
	@$(BIN)/python docs/images/drive.py
	@$(BIN)/python docs/images/report.py
	@$(BIN)/python docs/images/modes.py

page-pictures: $(READY)
	@$(BIN)/python docs/images/page.py

thesis: $(READY)
	@$(BIN)/python docs/images/thesis.py

docs: $(DOCS)/.ready
	@PYTHONSAFEPATH=1 $(DOCS)/bin/python docs/site/build.py && echo build/docs/html/index.html

# From a copy: a build writes the entry points of its folder anew, and what runs there at that instant finds no plugin.
wheel: $(READY)
	@rm -rf build/dist build/dist-source && mkdir -p build/dist-source
	@cp -R pyproject.toml setup.py README.md LICENSE artemis artemis_lab build/dist-source
	@$(BIN)/python -m pip wheel --quiet --quiet --disable-pip-version-check --no-build-isolation --no-deps \
		--wheel-dir build/dist ./build/dist-source
	@echo build/dist/*.whl

clean:
	rm -rf $(VENV) missions/runs missions/campaigns/runs build

$(READY): pyproject.toml
	@python="$(PYTHON)"; \
	for name in python3.11 python3; do \
		if [ -z "$$python" ] && "$$name" -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null; then \
			python="$$name"; \
		fi; \
	done; \
	if [ -z "$$python" ]; then \
		echo "artemis needs Python 3.11 or newer: neither python3.11 nor python3 is one." >&2; \
		echo "Install it, or name it: make PYTHON=/path/to/python3.11" >&2; \
		exit 1; \
	fi; \
	echo "setting up $(VENV) with $$("$$python" --version) (once, one to three minutes)"; \
	"$$python" -m venv $(VENV)
	@$(BIN)/python -m pip install --quiet --quiet --disable-pip-version-check --no-compile --editable '.[$(EXTRAS)]'
	@touch $@

# The compiled artemis has an environment of its own: what runs in $(VENV) is always the sources as they are. Behind its
# artemis it finds the packages of $(VENV), and this folder for the tests. The wheel is built from a copy: a build writes the
# entry points of its folder anew, and whatever runs in this one at that instant would find no plugin.
$(FAST)/.ready: $(READY) setup.py $(shell find artemis artemis_lab -name '*.py' -o -name '*.yaml' -o -name '*.txt')
	@echo "compiling into $(FAST) (a minute or two)"
	@rm -rf $(FAST) build/wheel build/source && mkdir -p build/source
	@cp -R pyproject.toml setup.py README.md LICENSE artemis artemis_lab build/source
	@ARTEMIS_COMPILE=1 $(BIN)/python -m pip wheel --quiet --disable-pip-version-check --no-build-isolation --no-deps \
		--wheel-dir build/wheel ./build/source
	@$(BIN)/python -m venv --without-pip $(FAST)
	@$(BIN)/python -m pip --python $(FAST) install --quiet --disable-pip-version-check --no-deps build/wheel/*.whl
	@$(BIN)/python -c "import os, sysconfig; print(sysconfig.get_path('purelib'), os.getcwd(), sep='\n')" \
		> $$($(FAST)/bin/python -c "import sysconfig; print(sysconfig.get_path('purelib'))")/behind.pth
	@touch $@

# What builds the site is no part of artemis' environment, but imports artemis from it.
$(DOCS)/.ready: $(READY) docs/site/requirements.txt
	@echo "setting up $(DOCS)"
	@rm -rf $(DOCS) && $(BIN)/python -m venv --without-pip $(DOCS)
	@$(BIN)/python -m pip --python $(DOCS) install --quiet --disable-pip-version-check -r docs/site/requirements.txt
	@$(BIN)/python -c "import os, sysconfig; print(sysconfig.get_path('purelib'), os.getcwd(), sep='\n')" \
		> $$($(DOCS)/bin/python -c "import sysconfig; print(sysconfig.get_path('purelib'))")/behind.pth
	@touch $@
