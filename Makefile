# make demo   everything from a fresh clone: environment, data, training, the report; given again after Ctrl-C, it goes on
# make try    a few scenes, the shipped weights scored on them, a report to look at: three minutes, nothing is trained
# make test   environment, lint, types, tests
# make check  the same and the longer checks
# make docs   the pages of docs/ as a site

PYTHON ?= python3
VENV   ?= .venv
RUN     = $(VENV)/bin/python
# Two test files at a time, one thread each: sooner than one file with two threads. Not those with many tests first, which would
# leave the long recipes for the end, with nothing beside them.
PYTEST  = OMP_NUM_THREADS=1 NUMBA_NUM_THREADS=1 $(RUN) -m pytest -n 2 --dist loadfile --no-loadscope-reorder
NAME   ?= demo
# MINUTES=5 ends the demo's training after so many minutes, annealed all the same: a shorter run than the README's table is of.
MINUTES ?=

.PHONY: help demo try test check check-slow lint docs devkit

help:
	@sed -n '/^# make/s/^# //p' Makefile

demo: $(VENV)/installed
	$(RUN) -m data_gen data=nano
	$(RUN) train.py experiment=demo name=$(NAME) skip_finished=true $(if $(MINUTES),trainer.max_minutes=$(MINUTES))
	$(RUN) eval.py run=runs/$(NAME)

# Scenes of another seed than those of data/nano, which the shipped weights were trained on.
try: $(VENV)/installed
	$(RUN) -m data_gen data=nano data.root=data/try data.num_scenes=16 seed=2026 data.split_weights.train=0 data.split_weights.test=0
	$(RUN) eval.py checkpoint=nano data.root=data/try

test: lint
	$(PYTEST) -m "not slow"

check: test check-slow

check-slow: $(VENV)/installed devkit
	$(PYTEST) -m slow

lint: $(VENV)/installed
	$(RUN) -m ruff check .
	$(RUN) -m ruff format --check .
	$(RUN) -m mypy

# The pages of docs/ as a site: site/index.html can be opened from the disk; its search needs `python -m http.server -d site`.
docs: $(VENV)/installed
	$(RUN) -m pip install --quiet --constraint constraints.txt --editable '.[docs]'
	NO_MKDOCS_2_WARNING=1 $(RUN) -m mkdocs build --strict

devkit:
	sh tools/devkit/setup.sh

$(VENV)/installed: pyproject.toml constraints.txt
	$(PYTHON) -m venv $(VENV)
	$(RUN) -m pip install --quiet --upgrade pip
	$(RUN) -m pip install --quiet --constraint constraints.txt --editable '.[dev]'
	touch $@
