# make demo | test | check | bench | fuzz | clean: see README.md
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin

.PHONY: env dev demo test clean

env: $(VENV)/.ready
dev: $(VENV)/.ready-dev

$(VENV)/.ready: pyproject.toml
	$(PYTHON) -m venv $(VENV)
	$(BIN)/pip install --quiet --upgrade pip
	$(BIN)/pip install --quiet -e '.[voice,fast]'
	touch $@

$(VENV)/.ready-dev: $(VENV)/.ready
	$(BIN)/pip install --quiet --group dev
	touch $@
