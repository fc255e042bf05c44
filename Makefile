# Alight: `make help` lists what there is. Needs python3 >= 3.11 and make; everything else goes into .venv.
SHELL := /bin/bash
.DEFAULT_GOAL := help
VENV := .venv
BIN := $(VENV)/bin
PORT ?= 22
DIR ?= alight
CONFIG ?= configs/raspberry-pi.toml
APRILTAG := pupil-apriltags==1.0.4.post11
export PYTHON SSH_OPTS ALIGHT_NO_SYSTEM
export PYTHONUNBUFFERED := 1

# A stamp holds the folder it was made in: a checkout that was moved or copied is set up again.
RUN_STAMP := $(VENV)/.runtime-installed
DEV_STAMP := $(VENV)/.dev-installed
stale = $(filter-out $(CURDIR),$(shell cat $(1) 2>/dev/null || echo none))
ifneq ($(call stale,$(RUN_STAMP)),)
.PHONY: $(RUN_STAMP)
endif
ifneq ($(call stale,$(DEV_STAMP)),)
.PHONY: $(DEV_STAMP)
endif

.PHONY: help setup dev demo test sitl-test bench-negatives check lint types imports format deploy lock clean

help: ## this list
	@awk 'BEGIN { FS = ":.*## " } /^[a-z-]+:.*## / { printf "  make %-15s %s\n", $$1, $$2 }' $(MAKEFILE_LIST)

setup: $(RUN_STAMP) ## .venv with all that Alight runs on, and .venv/bin/alight
	@echo "alight: ready: $(BIN)/alight"

dev: $(DEV_STAMP) ## the same with the tools of `make check`
	@echo "alight: ready, with the tools of make check"

$(RUN_STAMP): requirements.lock pyproject.toml deploy/venv.sh
	@echo "alight: setting up $(VENV) from $<"
	@deploy/venv.sh $<
	@printf '%s\n' '$(CURDIR)' >$@

$(DEV_STAMP): requirements-dev.lock $(RUN_STAMP)
	@echo "alight: adding the tools of $< to $(VENV)"
	@deploy/venv.sh $<
	@printf '%s\n' '$(CURDIR)' >$@

demo: $(RUN_STAMP) ## fly the paper's two experiments in the built-in simulator
	@$(BIN)/alight demo $(ARGS)

bench: $(RUN_STAMP) ## measure the eye against ArUco and AprilTag, a few minutes
	@$(BIN)/python -c 'import pupil_apriltags' 2>/dev/null || \
		$(BIN)/python -m pip --disable-pip-version-check --quiet install --no-deps '$(APRILTAG)'
	@$(BIN)/python tests/bench/run.py $(ARGS)

test: $(DEV_STAMP) ## the tests
	@$(BIN)/python -m pytest -m 'not sitl' $(ARGS)

sitl-test: $(DEV_STAMP) ## the tests that fly a PX4 SITL: PX4_SITL=udpin://127.0.0.1:14540, or a px4 binary
	@$(BIN)/python -m pytest -m sitl -rs $(ARGS) tests/sitl

bench-negatives: $(DEV_STAMP) ## count false detections in 10,000 frames without a landmark
	@$(BIN)/python tests/bench/photos.py
	@OMP_NUM_THREADS=1 $(BIN)/python tests/bench/negatives.py --count 10000 $(ARGS)

check: lint types imports test ## all that CI runs

lint: $(DEV_STAMP) ## style of the code
	@$(BIN)/ruff check .
	@$(BIN)/ruff format --check .

types: $(DEV_STAMP) ## strict types
	@$(BIN)/mypy

imports: $(DEV_STAMP) ## imports point downward
	@$(BIN)/lint-imports

format: $(DEV_STAMP) ## put the style right
	@$(BIN)/ruff check --fix .
	@$(BIN)/ruff format .

deploy: ## install on a Pi: make deploy HOST=user@pi [DIR=alight] [PORT=22] [CONFIG=...] [RESTART=1]
	@HOST='$(HOST)' DIR='$(DIR)' PORT='$(PORT)' CONFIG='$(CONFIG)' RESTART='$(RESTART)' deploy/push.sh

lock: ## resolve the versions anew into requirements.lock and requirements-dev.lock
	@deploy/lock.sh $(ARGS)

clean: ## remove .venv and the caches
	rm -rf $(VENV) .mypy_cache .ruff_cache .pytest_cache .import_linter_cache .hypothesis
