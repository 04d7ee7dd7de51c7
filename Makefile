# make demo       train the paper's smallest scenario and compare it with the baselines
# make quick      tests from every folder in a minute, for everyday work
# make test       lint, types and the whole test suite
# make coverage   which lines and branches the whole test suite runs
# make reproduce  the paper's figures, tables and claims: a quarter of an hour on two cores
# make site       the documentation site, in build/site, in some minutes: open build/site/index.html
# make images     the pictures of README.md and docs/, made anew
# make pretrained the weights of the policy that comes with the package: an hour on two cores
# make bench      speed of environment and trainer, side by side with others: eight minutes
# make campaigns  bad input, kills and random slots by the thousand: ten minutes on two cores
# make integrations        other people's trainers, each in a virtual environment of its own
# make integrations-rllib  one of them: agilerl, benchmarl, rllib or tianshou

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
DEMO := runs/demo

.PHONY: demo reproduce pretrained docs site images quick test lint types pytest coverage campaigns format bench integrations clean

# Tests of a file, and so the fixtures that they share, stay together as long as both are busy.
SPREAD := -n auto --dist worksteal

# Each stamp stands for an installation that need not be repeated.
RUNTIME := $(VENV)/.runtime-installed
TEST := $(VENV)/.test-installed
SITE := $(VENV)/.site-installed
EMISSIONS := $(VENV)/.emissions-installed
BENCH := $(VENV)/.bench-installed
PIP := $(BIN)/pip install --quiet --disable-pip-version-check

$(RUNTIME): pyproject.toml constraints.txt
	$(PYTHON) -c 'import sys; sys.exit("Python 3.11 or later is needed" if sys.version_info < (3, 11) else 0)'
	$(PYTHON) -m venv $(VENV)
	# torch first, at its exact version: any range would draw in GPU packages of several GB.
	$(PIP) torch==2.13.0
	$(PIP) --constraint constraints.txt hatchling
	$(PIP) --constraint constraints.txt --no-build-isolation --editable '.[report]'
	touch $@

$(TEST): $(RUNTIME)
	$(PIP) --constraint constraints.txt --no-build-isolation --editable '.[test]'
	touch $@

$(SITE): $(RUNTIME)
	$(PIP) --constraint constraints.txt --no-build-isolation --editable '.[docs]'
	touch $@

$(EMISSIONS): $(RUNTIME)
	$(PIP) --constraint constraints.txt --no-build-isolation --editable '.[emissions]'
	touch $@

# In isolation: what VMAS needs is built by tools that are not installed here.
$(BENCH): $(TEST)
	$(PIP) --constraint constraints.txt --editable '.[bench]'
	touch $@

demo: $(RUNTIME)
	rm -rf $(DEMO)
	$(BIN)/iout train paper/k3-fdd --out $(DEMO)
	$(BIN)/iout evaluate paper/k3-fdd --policy $(DEMO) --policy greedy --policy round-robin --policy random-walk
	$(BIN)/iout replay paper/k3-fdd --policy $(DEMO) --policy greedy --out $(DEMO)/replay.html

reproduce: $(EMISSIONS)
	$(BIN)/iout reproduce

# Both side by side; what was stopped goes on.
WEIGHTS := runs/weights
pretrained: $(RUNTIME)
	@for mode in fdd tdd; do \
		how=--out; test -e $(WEIGHTS)/$$mode/scenario.yaml && how=--resume; \
		$(BIN)/iout train pretrained/$$mode $$how $(WEIGHTS)/$$mode & \
		pids="$$pids $$!"; \
	done; for pid in $$pids; do wait $$pid || exit; done
	$(BIN)/python -m trainers.pretraining $(WEIGHTS)/fdd $(WEIGHTS)/tdd

# Tables that the software makes of itself, and the pages of the committed results;
# RESULTS=runs/paper, MULTI=runs/multi, GAP=runs/gap, FAIRNESS=runs/fairness, BAY=runs/bay,
# SEA=runs/sea, PRETRAINED=runs/pretrained, LIFE=runs/sea-life and DEPLOYMENTS=runs/sea-deployments
# take over those of new runs.
define TAKE
	$(if $($(1)),mkdir -p docs/$(2) && cp $($(1))/results.json $($(1))/results.csv docs/$(2)/)

endef
define PAGE
	$(call TAKE,$(1),$(2))
	$(BIN)/iout report docs/$(2) --markdown docs/$(3).md

endef
docs: $(RUNTIME)
	$(call PAGE,RESULTS,results,reproduction)
	$(call PAGE,MULTI,multi,multi-auv-results)
	$(call PAGE,GAP,gap,gap-results)
	$(call PAGE,FAIRNESS,fairness,fairness-results)
	$(call PAGE,BAY,bay,bay-results)
	$(call PAGE,SEA,sea,sea-results)
	$(call TAKE,PRETRAINED,pretrained)
	$(call TAKE,LIFE,sea-life)
	$(call TAKE,DEPLOYMENTS,sea-deployments)
	$(BIN)/python docs/tables.py

# Strictly: a warning, of a broken link say, is an error (and with --quiet it would not be one).
site: $(SITE)
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict

# The pictures of README.md and docs/; of the report in a browser, see CONTRIBUTING.md.
images: $(TEST)
	$(BIN)/python docs/images/make.py
	$(BIN)/python docs/images/model.py

quick: $(TEST)
	$(BIN)/pytest $(SPREAD) -m "not slow and not browser and not campaign"

test: lint types pytest

lint: $(TEST)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

types: $(TEST)
	$(BIN)/mypy

# What is compiled is kept: each of many processes would compile it anew.
pytest: export PYTHONDONTWRITEBYTECODE :=
pytest: $(TEST)
	$(BIN)/pytest $(SPREAD)

coverage: $(TEST)
	$(BIN)/pytest $(SPREAD) --cov --cov-report=term

campaigns: $(TEST)
	PYTHONPATH=tests $(BIN)/python -m campaigns

format: $(TEST)
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

bench: $(BENCH)
	$(BIN)/python benchmarks/environment.py
	$(BIN)/python benchmarks/training.py
	$(BIN)/python benchmarks/learning_step.py
	$(BIN)/python benchmarks/time_to_quality.py --seeds 1 --limit 30
	$(BIN)/python benchmarks/sea.py --repeats 3

# Libraries whose pins exclude one another; networks as small as these lose by a second thread.
INTEGRATIONS := agilerl benchmarl rllib tianshou

integrations: $(INTEGRATIONS:%=integrations-%)

.PHONY: $(INTEGRATIONS:%=integrations-%)
$(INTEGRATIONS:%=integrations-%): integrations-%: $(VENV)-integrations/%/.installed
	OMP_NUM_THREADS=1 $(VENV)-integrations/$*/bin/python tests/examples/learns.py $*

$(VENV)-integrations/%/.installed: examples/requirements/%.txt pyproject.toml
	$(PYTHON) -m venv $(@D)
	# torch first, as above; hatchling and setuptools for what is built without isolation.
	$(@D)/bin/pip install --quiet --disable-pip-version-check torch==2.13.0 hatchling setuptools
	$(@D)/bin/pip install --quiet --disable-pip-version-check --no-build-isolation \
	  --requirement $< --editable .
	touch $@

clean:
	rm -rf $(VENV) $(VENV)-integrations build dist .mypy_cache .pytest_cache .ruff_cache .hypothesis
