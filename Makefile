# `make demo` and `make test` set up what they need: a virtual environment in .venv, made anew when pyproject.toml changes.
# Another interpreter: make PYTHON=/path/to/python3.12 test. Other extras: make EXTRAS=dev,cluster test, after `make clean`.

VENV := .venv
EXTRAS := dev
BIN := $(VENV)/bin
READY := $(VENV)/.ready

# Where it is set, every worker and every `artemis` that the tests start would compile everything again.
unexport PYTHONDONTWRITEBYTECODE

.PHONY: demo test test-all check bench bench-followers host-death campaign coverage core-coverage mutation fuzz picture thesis clean

demo: $(READY)
	@$(BIN)/artemis run missions/figure_eight.yaml

test: $(READY)
	@$(BIN)/python -m pytest

test-all: $(READY)
	@$(BIN)/python -m pytest -m "" --hypothesis-profile=exhaustive

check: $(READY)
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/mypy
	$(BIN)/lint-imports --no-cache

bench: $(READY)
	@$(BIN)/python -m tests.bench

bench-followers: $(READY)
	@$(BIN)/artemis bench followers --output build/bench-followers $(if $(PYTHON_ROBOTICS),--python-robotics $(PYTHON_ROBOTICS))

host-death: $(READY)
	@$(BIN)/python -m tests.host_death --cases 200

campaign: $(READY)
	@$(BIN)/artemis campaign missions/campaigns/everything.yaml

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
	@$(BIN)/python docs/images/figure_eight.py

thesis: $(READY)
	@$(BIN)/python docs/images/thesis.py

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
	echo "setting up $(VENV) with $$("$$python" --version) (once, about a minute)"; \
	"$$python" -m venv $(VENV)
	@$(BIN)/python -m pip install --quiet --quiet --disable-pip-version-check --editable '.[$(EXTRAS)]'
	@touch $@
