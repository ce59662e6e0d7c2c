# SlopeWatch: `make demo` and `make test` each do everything on a fresh Debian 12 or 13, as root or with sudo.
SHELL := /bin/bash
.DEFAULT_GOAL := help
.PHONY: help setup demo test test-engine test-plugin check fuzz kills lint format docs bench model model-relief package install uninstall clean

PYTHON := .venv/bin/python
QGIS_PYTHON := .venv-qgis/bin/python
# The environment of `make setup` where there is one, else that which is active.
CHECK := $(if $(wildcard $(PYTHON)),.venv/bin/)
ENGINE_TESTS := $(wildcard tests/architecture tests/interface tests/api tests/engine tests/models tests/simulation tests/workflows tests/cli \
	tests/refusals tests/trust tests/accuracy tests/scripts tests/lab)
PLUGIN_TESTS := $(wildcard tests/plugin tests/processing_algorithms tests/qgis)
TYPED := interface engine models simulation workflows cli api library
FAST_TESTS := $(wildcard tests/architecture tests/interface tests/engine/core tests/engine/statistics tests/engine/geometry tests/engine/crs \
	tests/engine/grid tests/engine/epochs tests/engine/vector)
# Of the packages named. The link is the name under which mypy finds them.
define STYLE
	mkdir -p .setup/package && ln -sfn "$(CURDIR)" .setup/package/slopewatch
	$(CHECK)python -m ruff check .
	$(CHECK)python -m ruff format --check .
	MYPYPATH=.setup/package $(CHECK)python -m mypy $(addprefix -p slopewatch.,$(1))
	PYTHONPATH=.setup/package $(CHECK)lint-imports
endef
# More options for pytest: make test PYTEST="-k ground -x"
PYTEST :=
# Tests side by side, each process with one thread. Neighbours stay together, as they share clouds; a process that has
# nothing left takes half of what another still has, so that no long file is left to one of them at the end.
PARALLEL := -n auto --dist worksteal
ONE_THREAD := OPENBLAS_NUM_THREADS=1

help:  ## This list
	@grep -hE '^[a-z-]+:.*##' $(MAKEFILE_LIST) | sed -E 's/^([a-z-]+):.*## */  make \1\t/' | expand -t 22

setup:  ## PDAL, QGIS, the engine's environment, the plugin in a private QGIS profile (what works is kept)
	@scripts/setup.sh

demo: setup  ## Two simulated surveys through QGIS: rasters, zones, heatmap, figures against the truth
	@scripts/demo.sh

test: test-engine test-plugin  ## All tests

test-engine: setup  ## Engine, simulation and set-up, in .venv
	$(ONE_THREAD) $(PYTHON) -m pytest $(PARALLEL) $(ENGINE_TESTS) $(PYTEST)

test-plugin: setup  ## Plugin and toolbox, in QGIS's own Python and through qgis_process
	QT_QPA_PLATFORM=offscreen PYTHONPATH=/usr/share/qgis/python/plugins $(QGIS_PYTHON) -m pytest $(PARALLEL) --maxprocesses 4 \
		$(PLUGIN_TESTS) $(PYTEST)

check:  ## Style, types and the fast tests: needs `pip install -e .[dev]` alone, neither PDAL nor QGIS
	$(call STYLE,$(TYPED))
	$(ONE_THREAD) $(CHECK)python -m pytest -m "not slow" $(FAST_TESTS) $(PYTEST)  # one process, which parses each file once

fuzz: setup  ## Damaged files of every kind through the commands, for 20 minutes (FUZZ="--minutes 5 --seed 2")
	$(ONE_THREAD) OMP_NUM_THREADS=1 nice -n 10 $(PYTHON) -m slopewatch.lab.fuzz --minutes 20 $(FUZZ)

kills: setup  ## Commands killed at every rename and at random moments, full disks, removed folders, two runs at once
	$(ONE_THREAD) OMP_NUM_THREADS=1 $(PYTHON) lab/kills/kills_at_renames.py
	$(ONE_THREAD) OMP_NUM_THREADS=1 $(PYTHON) lab/kills/kills.py $(KILLS)

lint:  ## ruff, mypy and the layers of the packages, the laboratory too
	$(call STYLE,$(TYPED) lab.benchmarks lab.making)

format:  ## Let ruff rewrite what it can
	$(PYTHON) -m ruff check --fix .
	$(PYTHON) -m ruff format .

docs:  ## The documents as a site in build/site; needs only Python and pip
	python3 -m venv build/docs
	build/docs/bin/pip install --quiet ".[docs]"
	PYTHONPATH= NO_MKDOCS_2_WARNING=1 build/docs/bin/mkdocs build --strict

bench: setup  ## Accuracy and speed compared with the published method and its peers, as a table
	$(PYTHON) -m slopewatch.lab

model: setup  ## The shipped screening weights, their figures and card, from nothing (hours on a processor; goes on where broken off)
	$(PYTHON) -m slopewatch.lab.making weights --folder build/model/weights
	$(PYTHON) -m slopewatch.lab.making figures
	$(PYTHON) -m slopewatch.lab.making figures --residual
	for recipe in slopewatch paper residual; do \
		$(PYTHON) -m slopewatch.lab.making folds --recipe $$recipe --folder build/model/$$recipe || exit 1; done
	$(PYTHON) -m slopewatch.lab.making ablation --folder build/model/ablation
	$(PYTHON) -m slopewatch.lab.making card --folds slopewatch build/model/slopewatch --folds paper build/model/paper

# The weights of the network on relief in two stages, the second at half the rate; both go on where they were broken off.
model-relief: setup  ## The same for the network on relief: make model-relief GROUND=folder of real ground (2 hours)
	$(if $(GROUND),,$(error name the folder of real ground: make model-relief GROUND=FOLDER))
	$(PYTHON) -m slopewatch.lab.making relief --ground $(GROUND) --slopes 200 --steps 4000 \
		--weights build/model/relief_first.safetensors --folder build/model/relief_first
	$(PYTHON) -m slopewatch.lab.making relief --ground $(GROUND) --slopes 140 --steps 1200 --seed 10 --rate 0.002 \
		--start build/model/relief_first.safetensors --weights build/model/relief.safetensors --folder build/model/relief

package:  ## The plugin as a zip for QGIS, from the last commit: dist/slopewatch-VERSION.zip
	@scripts/package.sh

install: setup  ## Link the plugin into your own QGIS profile and switch it on
	@scripts/setup.sh install

uninstall:  ## Take that link away again
	@scripts/setup.sh uninstall

clean:  ## Remove everything that set-up, tests and demo made in this folder (not the system's packages)
	rm -rf .venv .venv-qgis .pdal .pdal.new .qgis .setup build dist demo *.egg-info .pytest_cache .mypy_cache .ruff_cache
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
