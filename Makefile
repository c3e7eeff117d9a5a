# `make demo` and `make test` set up their own virtual environment; nothing else needs to be installed first.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
DEMO ?= out/demo
# One thread per process: the programs run one process per core.
export OMP_NUM_THREADS ?= 1
# Some machines forbid the compiled modules: each of the hundreds of processes of the tests would compile them again.
unexport PYTHONDONTWRITEBYTECODE

.PHONY: help setup demo test messages smoke figures site fuzz check types format clean lowest

help:
	@echo "make demo    explore the bundled plans, write map pairs and a contact sheet to $(DEMO)"
	@echo "make test    run the tests, the same examples each time"
	@echo "make messages  build the ROS 2 messages that have no wheel: tests with real tf2_msgs, nav2_msgs, map_msgs"
	@echo "make smoke   the paper's experiments at the smallest scale: out/smoke/report.html"
	@echo "make figures write the figures of benchmarks/results into the README and the documentation"
	@echo "make site    build the documentation: out/site/index.html"
	@echo "make fuzz    search for examples that fail, until one is found or Ctrl-C is pressed;"
	@echo "             CASES=1000: try so many damaged files on each reader, and stop"
	@echo "make lowest  the tests that need it most, with the lowest versions of the packages that are allowed"
	@echo "make check   format, lint and type checks"
	@echo "make format  fix what the formatter and the linter can"
	@echo "make clean   remove the virtual environment and the caches"

$(VENV)/bin/python:
	$(PYTHON) -m venv $(VENV)

# For developers, new files are importable at once; the mode of pyproject.toml, for users, needs another installation for that.
EDITABLE := --config-settings editable_mode=lenient --editable

# What a user needs: no torch.
$(VENV)/.base: setup.py pyproject.toml constraints.txt | $(VENV)/bin/python
	$(BIN)/pip install --quiet --constraint constraints.txt $(EDITABLE) .
	@touch $@

# What a developer needs: every extra that the tests exercise.
$(VENV)/.dev: setup.py pyproject.toml constraints.txt | $(VENV)/bin/python
	$(BIN)/pip install --quiet --constraint constraints.txt $(EDITABLE) ".[films,agents,gan,hub,offline,ifc,ray,ros,ros2,human,teams,viz,site,dev]"
	@touch $@ $(VENV)/.base

setup: $(VENV)/.dev

demo: $(VENV)/.base
	$(BIN)/slamgym generate --plans bundled --pairs 8 --workers 2 --seed 1 --out $(DEMO)

test: $(VENV)/.dev
	$(BIN)/slamgym warmup --batched
	$(BIN)/python -m pytest -n 2 --dist loadfile --max-worker-restart 0 --import-mode=importlib

messages: $(VENV)/.dev
	$(BIN)/python tests/ros2/message_packages.py build/ros_messages

smoke: $(VENV)/.dev
	$(BIN)/slamgym reproduce --scale smoke --out out/smoke

figures: $(VENV)/.dev
	$(BIN)/python benchmarks/figures.py

site: $(VENV)/.dev
	$(BIN)/python docs/notebooks.py --run build/notebooks
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --quiet --strict

# The lowest versions that pyproject.toml allows of what the package leans on most, the others as pip finds them; the tests
# of every day run with those of constraints.txt.
LOWEST := .venv-lowest
LEANS_ON := numpy|gymnasium|pymunk|stable-baselines3
LOWEST_TESTS := tests/envs tests/sim tests/core/test_geometry.py tests/core/test_types.py tests/slam/test_particle_filter.py \
	tests/agents/test_explorers.py tests/agents/test_explorers_in_sb3.py tests/agents/test_training.py tests/dataset/test_pair.py
lowest:
	$(PYTHON) -m venv $(LOWEST)
	grep -oE '"($(LEANS_ON))>=[0-9.]+' pyproject.toml | sed 's/"//; s/>=/==/' | sort -u > $(LOWEST)/constraints.txt
	$(LOWEST)/bin/pip install --quiet --constraint $(LOWEST)/constraints.txt $(EDITABLE) ".[agents,human,dev]"
	$(LOWEST)/bin/python -m pytest --import-mode=importlib $(LOWEST_TESTS)

# What was found is kept in .hypothesis and tried first in the next search.
fuzz: $(VENV)/.dev
ifdef CASES
	HYPOTHESIS_PROFILE=fuzz FUZZ_CASES=$(CASES) $(BIN)/python -m pytest tests/fuzz -n 2 --import-mode=importlib
else
	while HYPOTHESIS_PROFILE=fuzz $(BIN)/python -m pytest -m hypothesis -n 2 --import-mode=importlib; do :; done; false
endif

check: $(VENV)/.dev
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(MAKE) types

# mypy reads packages where their names say: the three folders are put together below build/, with the times of their files,
# by which it knows what it has checked already.
types: $(VENV)/.dev
	rm -rf build/types && mkdir -p build/types && cp -Rp slamgym build/types && cp -Rp agents gan build/types/slamgym
	$(BIN)/mypy

format: $(VENV)/.dev
	$(BIN)/ruff format .
	$(BIN)/ruff check --fix .

# Not all of build/: an editable installation for users leads to a tree of links there.
clean:
	rm -rf $(VENV) $(LOWEST) build/types build/site build/notebooks build/lib build/bdist.* dist *.egg-info .mypy_cache .ruff_cache .pytest_cache .hypothesis
	find slamgym agents gan tests benchmarks -name __pycache__ -type d -prune -exec rm -rf {} +
