# The DAG of vt-pipeline. `make` lists the targets.
#
#   MANIFEST  which objects: toy, procedural, four-classes, pybullet-objects, directory, warehouse, or a YAML file  (toy)
#   PRESET    draft, standard or paper                                                       (draft)
#   SHARDS    into how many shards the objects are split; `make -j` works on them side by side  (1)
#   WORKERS   processes a shard; 0 for one a core                                            (0, with -j 1)
#   DATA      where the data set goes                                                        (data/MANIFEST/PRESET, or data/MANIFEST-OBJECTS/PRESET)
#   OBJECTS   folder of meshes, for manifests that name none
#   SET       settings: SET="simulate-grasps.attempts=20 simulate-touch.tracer=sphere"
#   CONFIGURATIONS  graph networks to train and evaluate; what none of them sees or feels is not made
#                   (none touch occluded occluded-touch unoccluded unoccluded-touch)

MANIFEST ?= toy
PRESET   ?= draft
SHARDS   ?= 1
DATA     ?= data/$(basename $(notdir $(MANIFEST)))$(if $(OBJECTS),-$(notdir $(abspath $(OBJECTS))))/$(PRESET)
OBJECTS  ?=
SET      ?=
CONFIGURATIONS ?= none touch occluded occluded-touch unoccluded unoccluded-touch
VENV     ?= .venv
PYTHON   ?= python3.11

# Under `make -j` shards run side by side, if there are several; else a shard's objects do, on all cores.
WORKERS  ?= $(if $(and $(filter -j%,$(MAKEFLAGS)),$(filter-out 1,$(SHARDS))),1,0)

BIN      := $(VENV)/bin
APT      := libegl1 libgl1 libxrender1 libgl1-mesa-dri
NUMBERS  := $(shell seq 0 $$(($(SHARDS) - 1)) 2>/dev/null)
ifeq ($(NUMBERS),)
$(error SHARDS is $(SHARDS); it must be a whole number, 1 or more)
endif
RUN       = $(BIN)/vt-pipeline run $@ --manifest $(MANIFEST) --preset $(PRESET) --data $(DATA) \
            $(if $(OBJECTS),--objects $(OBJECTS)) $(addprefix --set ,$(SET)) --workers $(WORKERS) --shards $(SHARDS)
SHARD     = $(subst $@,$(basename $@),$(RUN)) --shard $(subst .,,$(suffix $@))

.DEFAULT_GOAL := help
.PHONY: help setup system dataset summary train train-unet evaluate report reproduce test test-slow test-cpus lint bench bench-peers tradeoff tradeoff-missing clean FORCE
FORCE:

help:  ## list the targets
	@grep -hE '^[a-z-]+:.*## ' $(MAKEFILE_LIST) | awk -F ':.*## ' '{printf "  make %-16s %s\n", $$1, $$2}'

dataset: summary  ## make the data set, then print its statistics and draw its contact sheets

# ---- the stages: a target a stage and shard; only the runner knows whether there is anything to do, so it is always asked

sample-surfaces.%: $(VENV)/installed FORCE
	@$(SHARD)
simulate-grasps.%: sample-surfaces.%
	@$(SHARD)
render-vision.%: simulate-grasps.%
	@$(SHARD)
simulate-touch.%: simulate-grasps.%
	@$(SHARD)


SURFACES  = $(addprefix sample-surfaces.,$(NUMBERS))
IMAGES    = $(addprefix render-vision.,$(NUMBERS))
TOUCHES   = $(addprefix simulate-touch.,$(NUMBERS))
CHARTS    = $(addprefix fit-charts.,$(NUMBERS))

train-unet: $(TOUCHES)
	@$(RUN)
fit-charts.%: train-unet
	@$(SHARD)

.SECONDEXPANSION:
train-gcn.%: $$(SURFACES) $$(if $$(findstring occluded,$$*)$$(findstring image,$$*),$$(IMAGES)) $$(if $$(findstring touch,$$*),$$(CHARTS))
	@$(subst $@,train-gcn,$(RUN)) --set train-gcn.configuration=$*

comma    := ,
space    := $(subst ,, )
train: $(addprefix train-gcn.,$(CONFIGURATIONS))  ## train every network: the one that reads touches, and the graph networks
evaluate: train $(TOUCHES)  ## measure the graph networks on the test objects, beside the supplement's tables
	@$(RUN) --set 'evaluate.configurations=[$(subst $(space),$(comma),$(strip $(CONFIGURATIONS)))]'
report: evaluate  ## say whether the supplement's orderings hold; draw learning curves and reconstructions
	@$(BIN)/vt-pipeline report $(DATA)

reproduce:  ## the supplement's claims, tested on 240 modelled objects: data set, training, evaluation, report
	@began=$$(date +%s); $(MAKE) --no-print-directory summary MANIFEST=four-classes PRESET=draft && made=$$(date +%s) && \
	$(MAKE) --no-print-directory -j$$(nproc) report MANIFEST=four-classes PRESET=draft && \
	echo "data set: $$(((made - began) / 60)) min; training, evaluation and report: $$((($$(date +%s) - made) / 60)) min on $$(nproc) cores"

.PRECIOUS: sample-surfaces.% simulate-grasps.% render-vision.% simulate-touch.% fit-charts.% train-gcn.%

summary: $(IMAGES) $(TOUCHES)
	@$(BIN)/vt-pipeline summary $(DATA)

# ---- what has to be installed

setup: $(VENV)/installed  ## install everything that is needed: system libraries, .venv, pinned packages

system:
	@command -v dpkg-query >/dev/null || exit 0; \
	missing=$$(for name in $(APT); do dpkg-query -W -f '$${Status}' $$name 2>/dev/null | grep -q 'ok installed' || echo $$name; done; \
	           $(PYTHON) -c 'import ensurepip' 2>/dev/null || echo python3.11-venv); \
	if [ -z "$$missing" ]; then :; \
	elif [ "$$(id -u)" = 0 ]; then \
	    echo "installing" $$missing; \
	    apt-get update -qq && DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends $$missing >/dev/null; \
	else \
	    echo "system libraries are missing, and only root may install them. Please run:"; echo "    sudo apt-get install -y" $$missing; exit 1; \
	fi

$(VENV)/installed: pyproject.toml constraints.txt | system
	@test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	@echo "installing packages into $(VENV) (about two minutes)"
	@$(BIN)/pip install --quiet --disable-pip-version-check -c constraints.txt -e .
	@touch $@

$(VENV)/installed-dev: $(VENV)/installed
	@$(BIN)/pip install --quiet --disable-pip-version-check -c constraints.txt -e '.[dev]'
	@touch $@

# ---- tests and measurements

lint: $(VENV)/installed-dev  ## check style, types and the direction of imports
	@$(BIN)/ruff check . && $(BIN)/ruff format --check . && $(BIN)/mypy && $(BIN)/lint-imports --no-cache

test: lint  ## run the tests, a toy shard through every stage among them (under 10 minutes on 2 cores)
	@$(BIN)/pytest -n auto --dist loadfile -m 'not slow'

test-cpus: lint  ## run the tests as on older processors: without AVX-512, and without AVX2 and FMA
	@for name in haswell prescott; do \
	    echo "as on $$name"; $(BIN)/python -m tests.processors $$name $(BIN)/pytest -n auto --dist loadfile -m 'not slow' || exit 1; done

test-slow: lint  ## run the same suites at full size
	@$(BIN)/pytest -n auto --dist loadfile --hypothesis-profile thorough

bench: $(VENV)/installed-dev  ## measure every stage beside its raw limit, in one run
	@for name in surfaces grasps vision touch chamfer unet charts gcn; do $(BIN)/python -m benchmarks.$$name || exit 1; done

tradeoff: $(VENV)/installed-dev  ## measure what every setting costs and how wrong it is; writes docs/tradeoff.md (about two hours)
	@$(BIN)/python -m benchmarks.tradeoff

tradeoff-missing: $(VENV)/installed-dev  ## list the settings that make tradeoff has not measured, or on older code
	@$(BIN)/python -m benchmarks.tradeoff.missing

PEERS    := .venv-peers

bench-peers: $(PEERS)/installed $(PEERS)-tacto/installed simulate-touch.0  ## measure TACTO, Taxim, KeOps, HDF5 … beside ours; writes docs/peers.md
	@KEOPS_CACHE_FOLDER=$(abspath $(PEERS))/keops OMP_NUM_THREADS=1 $(PEERS)/bin/python -m benchmarks.peers --data $(DATA) --write docs/peers.md

# The peers that get on with our packages see those of $(VENV), and are installed beside them; TACTO gets an environment of its own.
$(PEERS)/installed: $(VENV)/installed-dev benchmarks/peers/requirements.txt
	@test -x $(PEERS)/bin/python || $(BIN)/python -m venv $(PEERS)
	@$(BIN)/python -c 'import site; print("import site; site.addsitedir(%r)" % site.getsitepackages()[0])' \
	    > "$$($(PEERS)/bin/python -c 'import site; print(site.getsitepackages()[0])')/vt-pipeline.pth"
	@$(PEERS)/bin/pip install --quiet --disable-pip-version-check -c constraints.txt -r benchmarks/peers/requirements.txt
	@touch $@

$(PEERS)-tacto/installed: benchmarks/peers/requirements-tacto.txt | system
	@test -x $(PEERS)-tacto/bin/python || $(PYTHON) -m venv $(PEERS)-tacto
	@$(PEERS)-tacto/bin/pip install --quiet --disable-pip-version-check --no-deps -r $<
	@touch $@

clean:  ## remove the virtual environments; data is kept
	rm -rf $(VENV) .venv-peers .venv-peers-tacto
