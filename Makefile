# Every target works on a fresh machine with Python 3.11-3.13, pip and make.
PYTHON ?= python3
VENV   ?= .venv
BIN    := $(VENV)/bin
ROOMS  := pipelines robots datasets
# Two processes: each test keeps to one thread, and the slow ones need a minute each.
TESTS  ?= -n 2 --dist worksteal

.DEFAULT_GOAL := help
.PHONY: help demo check test test-fast fuzz soak format format-check lint types build clean
# make fuzz INPUTS=100000 SEED=1: mutated inputs in all, and which ones
INPUTS ?= 10000
# make soak KILLS=200: how often a verb is killed
KILLS  ?= 20
SEED   ?= 0

help:
	@echo "make demo       the whole chain on two cores, ends with a table of what came out"
	@echo "make check      format, lint, types and the fast tests: before every commit"
	@echo "make test       all tests              make test-fast  without the slow ones"
	@echo "make format     ruff format            make lint       ruff check"
	@echo "make types      mypy                   make build      wheel and sdist"
	@echo "make fuzz       mutated inputs for every reader, INPUTS=10000"
	@echo "make soak       every verb killed at random moments and resumed, KILLS=20"
	@echo "make clean      remove what was built  TESTS='-k ase'  other options of pytest"

demo: $(VENV)/.installed
	$(BIN)/lacoloco run quickstart

check: format-check lint types test-fast

test: $(VENV)/.dev
	@$(BIN)/python -m pytest $(TESTS)

test-fast: $(VENV)/.dev
	@$(BIN)/python -m pytest $(TESTS) -m "not slow"

fuzz: $(VENV)/.dev
	$(BIN)/python tests/test_fuzz.py $(INPUTS) $(SEED)

soak: $(VENV)/.dev
	$(BIN)/python tests/test_soak.py $(KILLS) $(SEED)

format: $(VENV)/.dev
	$(BIN)/ruff format .

format-check: $(VENV)/.dev
	$(BIN)/ruff format --check .

lint: $(VENV)/.dev
	$(BIN)/ruff check .

# The editable install maps robots/ to lacoloco.robots with an import hook that no type checker
# follows; three links in a git-ignored folder show them the same tree.
types: $(VENV)/.types
	@mkdir -p build/types/lacoloco
	@for room in $(ROOMS); do ln -sfn ../../../$$room build/types/lacoloco/$$room; done
	$(BIN)/mypy lacoloco_cli build/types/lacoloco

build: $(VENV)/.dev
	rm -rf dist
	$(BIN)/python -m build

clean:
	rm -rf build dist *.egg-info .pytest_cache .ruff_cache .mypy_cache .hypothesis MUJOCO_LOG.TXT
	find . -name __pycache__ -not -path "./$(VENV)/*" -prune -exec rm -rf {} +

# pip is upgraded first: the one that comes with Python 3.11 knows no dependency groups.
$(VENV)/.installed: pyproject.toml
	@$(PYTHON) -c "import sys; sys.exit(not (3, 11) <= sys.version_info < (3, 14))" \
	  || { echo "lacoloco needs Python 3.11-3.13: make PYTHON=python3.12"; exit 2; }
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --upgrade "pip>=25.1"
	$(BIN)/python -m pip install --quiet --editable .
	@touch $@

$(VENV)/.dev: $(VENV)/.installed
	$(BIN)/python -m pip install --quiet --group dev
	@touch $@

$(VENV)/.types: $(VENV)/.dev
	$(BIN)/python -m pip install --quiet --group types
	@touch $@
