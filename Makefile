PYTHON ?= python3
SCENE ?= data/scenes/figure1.json
VENV ?= .venv
BIN = $(VENV)/bin

.PHONY: install plan test test-slow lint docs docs-serve figures

install: $(VENV)/installed

$(VENV)/installed: pyproject.toml constraints.txt
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --constraint constraints.txt --editable '.[test]'
	touch $@

plan: install
	$(BIN)/python -m dvr_jax.plan $(SCENE) --out out/plan

test: install
	$(BIN)/python -m pytest -q -n 2 --dist loadfile

test-slow: install
	$(BIN)/python -m pytest -q -m slow

lint: install
	$(BIN)/ruff check dvr_jax tests examples docs
	$(BIN)/mypy

$(VENV)/docs-installed: $(VENV)/installed
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --constraint constraints.txt --editable '.[test,docs]'
	touch $@

# --nitpicky fails on a missing reference, --fail-on-warning on a dead link or a broken docstring.
docs: $(VENV)/docs-installed
	$(BIN)/python -m sphinx --builder html --nitpicky --fail-on-warning --keep-going --doctree-dir out/doctrees docs out/site

docs-serve: docs
	$(BIN)/python -m http.server --bind 127.0.0.1 --directory out/site 8000

# Figures of the concept pages and the animation of the README.
figures: $(VENV)/docs-installed
	$(BIN)/python docs/make_figures.py
