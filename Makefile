PYTHON ?= python3
SCENE ?= data/scenes/figure1.json
VENV ?= .venv
BIN = $(VENV)/bin

.PHONY: install plan test test-slow lint

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
	$(BIN)/ruff check dvr_jax tests
	$(BIN)/mypy
