# Makes datasets and trained models with vt-pipeline. `make` lists the targets and the variables below.
#
#   MANIFEST=toy      which objects: toy, one-of-each, procedural, four-classes, pybullet-objects, household, directory, warehouse, single-image,
#                     or a YAML file
#   PRESET=draft      draft, standard or paper
#   DATA=...          data directory, or s3://BUCKET/PREFIX; by default data/MANIFEST/PRESET, or data/MANIFEST-OBJECTS/PRESET
#   OBJECTS=...       folder of meshes, for manifests that name none
#   UNITS=mm UP=y     unit and up-axis of OBJECTS' files, to keep real sizes; by default what glTF, COLLADA and 3MF state; others: 0.5 m, z up
#   SET="..."         settings: SET="simulate-grasps.attempts=20 simulate-touch.tracer=sphere", no value with a blank (vt-pipeline --set takes it)
#   SHARDS=...        shards the objects are split into; by default the number that the dataset has, 1 for a new one
#   WORKERS=0         processes per shard; 0 is one per core (1 where `make -j` runs several shards at a time)
#   CONFIGURATIONS="none touch occluded occluded-touch unoccluded unoccluded-touch"
#                     graph networks to train and evaluate; images or touches that none of them uses are not made;
#                     implicit-touch, implicit-occluded, implicit-occluded-touch, implicit-unoccluded, implicit-unoccluded-touch too
#   SEEDS=0           trainings of each network, and evaluations of them: SEEDS="0 1 2" shows what is chance

blank    :=
MANIFEST ?= toy
PRESET   ?= draft
SHARDS   ?=
DATA     ?= data/$(basename $(notdir $(MANIFEST)))$(if $(OBJECTS),-$(subst $(blank) ,_,$(notdir $(abspath $(OBJECTS)))))/$(PRESET)
OBJECTS  ?=
SET      ?=
CONFIGURATIONS ?= none touch occluded occluded-touch unoccluded unoccluded-touch
SEEDS    ?= 0
VENV     ?= .venv
PYTHON   ?= python3.11
PEERS    := .venv-peers
HANDS    := .venv-hands

# The number of shards: as asked for, else as the dataset says of itself, else 1.
ifneq ($(findstring ://,$(DATA)),)
ifeq ($(wildcard $(VENV)/installed),)
$(error DATA is in object storage, and nothing is installed yet that could look there: run `make setup` first)
endif
KNOWN    := $(shell $(VENV)/bin/python -c 'from pipeline.store.directory import DataDirectory; print(DataDirectory("$(DATA)").shards() or "")')
ifneq ($(.SHELLSTATUS),0)
$(error $(DATA) cannot be reached; see the message above)
endif
else
KNOWN    := $(shell sed -n 's/.*"shards": *\([0-9]*\).*/\1/p' "$(DATA)/dataset.json" 2>/dev/null)
endif
COUNT    := $(or $(SHARDS),$(KNOWN),1)
NUMBERS  := $(shell seq 0 $$(($(COUNT) - 1)) 2>/dev/null)
ifeq ($(NUMBERS),)
$(error SHARDS is $(COUNT); it must be a whole number, 1 or more)
endif

# `make -j` works on several shards at a time, with one core each; otherwise the objects of one shard share all cores.
WORKERS  ?= $(if $(and $(filter -j%,$(MAKEFLAGS)),$(filter-out 1,$(COUNT))),1,0)

BIN      := $(VENV)/bin
APT      := libegl1 libgl1 libxrender1 libgl1-mesa-dri
RUN       = $(BIN)/vt-pipeline run $@ --manifest "$(MANIFEST)" --preset $(PRESET) --data "$(DATA)" \
            $(if $(OBJECTS),--objects "$(OBJECTS)") $(if $(UNITS),--units $(UNITS)) $(if $(UP),--up $(UP)) $(addprefix --set ,$(SET)) --workers $(WORKERS) $(if $(SHARDS)$(KNOWN),--shards $(COUNT))
SHARD     = $(subst $@,$(basename $@),$(RUN)) --shard $(subst .,,$(suffix $@))

.DEFAULT_GOAL := help
.PHONY: help docs setup system household dataset summary train train-unet evaluate train-single-image evaluate-single-image single-image renderings report reproduce test test-slow test-cpus site test-docs test-report test-exports showcase test-slurm test-storage test-sensors test-hands lint bench bench-peers tradeoff tradeoff-missing faults fuzz clean FORCE
FORCE:

help:  ## list the targets
	@echo "targets:"; grep -hE '^[a-z-]+:.*## ' $(MAKEFILE_LIST) | awk -F ':.*## ' '{printf "  make %-16s %s\n", $$1, $$2}'
	@echo; echo "variables:"; sed -n 's/^#   /  /p' $(firstword $(MAKEFILE_LIST))

dataset: summary  ## make the dataset, print its statistics and draw its contact sheets

.SUFFIXES:  # simulate-touch without a number is no program to link

# ---- The stages: one target per stage and shard. Each is always run: vt-pipeline itself knows what is up to date.
# tests/test_makefile.py checks that the prerequisites are the stages' inputs.

sample-surfaces.%: $(VENV)/installed FORCE
	@$(SHARD)
simulate-grasps.%: sample-surfaces.%
	@$(SHARD)
render-vision.%: simulate-grasps.%
	@$(SHARD)
simulate-touch.%: simulate-grasps.%
	@$(SHARD)
sample-distances.%: sample-surfaces.%
	@$(SHARD)

SURFACES  = $(addprefix sample-surfaces.,$(NUMBERS))
IMAGES    = $(addprefix render-vision.,$(NUMBERS))
TOUCHES   = $(addprefix simulate-touch.,$(NUMBERS))
CHARTS    = $(addprefix fit-charts.,$(NUMBERS))

train-unet: $(TOUCHES)  ## train the U-Net that predicts depth from tactile images
	@$(RUN)
fit-charts.%: train-unet
	@$(SHARD)

.SECONDEXPANSION:
# train-gcn.touch.1 is the training of the network `touch` with seed 1
TRAINING  = $(subst $@,$(1),$(RUN)) --set $(1).configuration=$(basename $*) --set $(1).training_seed=$(subst .,,$(suffix $*))
train-gcn.%: $$(SURFACES) $$(if $$(findstring occluded,$$*),$$(IMAGES)) $$(if $$(findstring touch,$$*),$$(CHARTS))
	@$(call TRAINING,train-gcn)
train-implicit.%: $(addprefix sample-distances.,$(NUMBERS)) $$(if $$(findstring occluded,$$*),$$(IMAGES)) $$(if $$(findstring touch,$$*),$$(CHARTS))
	@$(call TRAINING,train-implicit)

comma    := ,
space    := $(subst ,, )
FAMILIES  = implicit
# networks called FAMILY-… are trained by train-FAMILY, all others by train-gcn
NETWORKS  = $(foreach name,$(CONFIGURATIONS),$(firstword $(foreach family,$(FAMILIES),$(if $(filter $(family)-%,$(name)),train-$(family).$(name))) train-gcn.$(name)))
train: $(foreach seed,$(SEEDS),$(addsuffix .$(seed),$(NETWORKS)))  ## train these networks, and the U-Net for those that feel
evaluate.%: $$(addsuffix .$$*,$$(NETWORKS)) $(TOUCHES)
	@$(subst $@,evaluate,$(RUN)) --set evaluate.training_seed=$* --set 'evaluate.configurations=[$(subst $(space),$(comma),$(strip $(CONFIGURATIONS)))]'
evaluate: $(addprefix evaluate.,$(SEEDS))  ## evaluate these networks on the test objects, beside the supplement's tables
report: evaluate  ## check the supplement's orderings; write pages with gallery, figures and tables: DATA/report/index.html
	@$(BIN)/vt-pipeline report "$(DATA)"

# LONG=1: thirteen times the epochs for charts, five times for implicit networks, a night on 2 cores; killed, it continues where it was.
FOUR      = MANIFEST=four-classes PRESET=draft DATA=data/four-classes/$(if $(LONG),long,draft) \
            CONFIGURATIONS="$(CONFIGURATIONS) implicit-occluded-touch implicit-unoccluded" \
            SET="$(if $(LONG),train-gcn.epochs=80 train-implicit.epochs=500,evaluate.grasps=[1,5])"
reproduce:  ## test the supplement's claims on 240 procedural objects, networks of both families with three seeds each (LONG=1: overnight)
	@began=$$(date +%s); $(MAKE) --no-print-directory summary $(FOUR) && made=$$(date +%s) && \
	$(MAKE) --no-print-directory -j$$(nproc) report SEEDS="0 1 2" $(FOUR) && \
	echo "dataset: $$(((made - began) / 60)) min; training, evaluation and report: $$((($$(date +%s) - made) / 60)) min on $$(nproc) cores"

.PRECIOUS: sample-surfaces.% sample-distances.% read-renderings.% simulate-grasps.% render-vision.% simulate-touch.% fit-charts.% train-gcn.% train-implicit.% evaluate.%

summary: $(IMAGES) $(TOUCHES)  ## the statistics and contact sheets alone
	@$(BIN)/vt-pipeline summary "$(DATA)"

# ---- The supplement's last experiment (3.6): renderings of objects from all sides, one image each

read-renderings.%: sample-surfaces.%
	@$(SHARD)
train-single-image: $(SURFACES) $(addprefix read-renderings.,$(NUMBERS))
	@$(RUN)
evaluate-single-image: train-single-image
	@$(RUN)
single-image: evaluate-single-image  ## reconstruct from single images (Table 4), of MANIFEST=single-image OBJECTS=FOLDER
renderings: $(SURFACES)  ## write MANIFEST's objects as such a folder, data/renderings: meshes, and 24 images of each
	@$(BIN)/python -m pipeline.export.renderings $(DATA) data/renderings

# ---- Installation

setup: $(VENV)/installed  ## install system libraries and, into .venv, pinned packages

system:
	@missing=$$($(call missing,$(APT)); $(PYTHON) -c 'import ensurepip' 2>/dev/null || echo python3.11-venv); $(install)

# For the shell: the packages of a list that are not installed; and their installation.
missing   = command -v dpkg-query >/dev/null || exit 0; for name in $(1); do \
            dpkg-query -W -f '$${Status}' $$name 2>/dev/null | grep -q 'ok installed' || echo $$name; done
define install
if [ -z "$$missing" ]; then :; \
elif [ "$$(id -u)" = 0 ]; then \
    echo "installing" $$missing; \
    apt-get update -qq && DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends $$missing >/dev/null; \
else \
    echo "system packages are missing, and only root may install them. Please run:"; echo "    sudo apt-get install -y" $$missing; exit 1; \
fi
endef

$(VENV)/installed: pyproject.toml constraints.txt | system
	@command -v $(PYTHON) >/dev/null || test -x $(BIN)/python || { echo "there is no $(PYTHON), and the pinned packages need Python 3.11:" \
	"install python3.11 and python3.11-venv, or name one that you have: make setup PYTHON=/path/to/python3.11"; exit 1; }
	@test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	@echo "installing packages into $(VENV) (about two minutes)"
	@$(BIN)/pip install --quiet --disable-pip-version-check -c constraints.txt -e .
	@touch $@

$(VENV)/installed-dev: $(VENV)/installed
	@$(BIN)/pip install --quiet --disable-pip-version-check -c constraints.txt -e '.[dev]'
	@touch $@

household: $(VENV)/installed  ## install sweethome3d-furniture, and unpack its 820 models for MANIFEST=household; as root (120 MB)
	@missing=$$($(call missing,sweethome3d-furniture)); $(install)
	@test -e data/meshes/household/catalogue.csv || \
	$(BIN)/python -m pipeline.formats.furniture_library data/meshes/household /usr/share/sweethome3d/furniture/*.sh3f

# ---- Documents, tests and measurements

docs: $(VENV)/installed  ## regenerate docs/data-format.md and docs/settings.md
	@$(BIN)/python -m tools.reference_pages docs

lint: $(VENV)/installed-dev  ## check style, types and import directions
	@$(BIN)/ruff check . && $(BIN)/ruff format --check . && $(BIN)/mypy && $(BIN)/lint-imports --no-cache

test: lint  ## run the tests, among them a few objects through every stage (under 10 minutes on 2 cores)
	@$(BIN)/pytest -n auto --dist loadfile -m 'not slow'

test-cpus: lint  ## run the tests as on older processors: without AVX-512, and without AVX2 and FMA
	@for name in haswell prescott; do \
	    echo "as on $$name"; $(BIN)/python -m tests.processors $$name $(BIN)/pytest -n auto --dist loadfile -m 'not slow' || exit 1; done

test-slow: lint  ## run the same tests at full size
	@$(BIN)/pytest -n auto --dist loadfile --hypothesis-profile thorough

test-report: $(VENV)/installed-dev  ## click through a report in headless Chromium, with an accessibility checker; as root (4 minutes on 2 cores)
	@missing=$$($(call missing,chromium)); $(install)
	@$(BIN)/pip install --quiet --disable-pip-version-check -c constraints.txt -e '.[browser]'
	@$(BIN)/pytest -n 0 tests/browser/report_in_browser.py

test-exports: .venv-exports/installed  ## read exports back with LeRobot, Hugging Face, WebDataset and Rerun (4 minutes on 2 cores)
	@HF_HUB_OFFLINE=1 .venv-exports/bin/python -m pytest -n 0 tests/export/read_back.py

# The environment adds to $(VENV). LeRobot pins an older torch, but reads datasets with ours.
.venv-exports/installed: $(VENV)/installed-dev tests/export/requirements.txt
	@test -x .venv-exports/bin/python || $(BIN)/python -m venv .venv-exports
	@$(BIN)/python -c 'import site; print("import site; site.addsitedir(%r)" % site.getsitepackages()[0])' \
	    > "$$(.venv-exports/bin/python -c 'import site; print(site.getsitepackages()[0])')/vt-pipeline.pth"
	@.venv-exports/bin/pip install --quiet --disable-pip-version-check -c constraints.txt -r tests/export/requirements.txt
	@.venv-exports/bin/pip install --quiet --disable-pip-version-check --no-deps lerobot==0.4.4 accelerate==1.15.0
	@touch $@

site: $(VENV)/installed  ## build the documentation as pages: site/index.html
	@$(BIN)/pip install --quiet --disable-pip-version-check -c constraints.txt -e '.[docs]'
	@NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --quiet --strict --site-dir site && echo "site/index.html"

test-docs: $(VENV)/installed-dev site  ## check the pages' links, run the documents' commands and the notebook (half an hour on 2 cores)
	@$(BIN)/pytest -n 0 tests/examples/run_commands.py
	@PATH=$(abspath $(BIN)):$$PATH $(BIN)/python -m tests.examples.run_notebook examples/first_steps.ipynb

test-slurm: $(VENV)/installed-dev  ## install Slurm, start one of one node, and run all stages on it; as root (under 10 minutes on 2 cores)
	@missing=$$($(call missing,slurm-wlm munge)); $(install)
	@$(BIN)/pytest -n 0 tests/slurm/real_slurm.py

test-storage: $(VENV)/installed-dev  ## run all stages with their data on two servers of object storage, one killed again and again (4 minutes on 2 cores)
	@$(BIN)/pytest -n 0 -m slow tests/test_object_storage.py

bench: $(VENV)/installed-dev  ## measure every stage beside its raw limit, in one run
	@for name in surfaces grasps vision touch chamfer unet charts gcn; do $(BIN)/python -m benchmarks.$$name || exit 1; done

tradeoff: $(PEERS)/installed  ## measure what every setting costs and how wrong it is; writes docs/tradeoff.md (about two hours)
	@$(BIN)/python -m benchmarks.tradeoff
	@OMP_NUM_THREADS=1 $(PEERS)/bin/python -m benchmarks.tradeoff --only sensors

tradeoff-missing: $(VENV)/installed-dev  ## list the settings that make tradeoff has not measured, or on older code
	@$(BIN)/python -m benchmarks.tradeoff.missing

test-sensors: $(PEERS)/installed  ## test the shipped sensors on real photographs, beside Taxim; writes docs/sensors.md (2 minutes)
	@OMP_NUM_THREADS=1 $(PEERS)/bin/python -m benchmarks.real_sensors --write docs/sensors.md

faults: $(VENV)/installed-dev  ## inject some 500 faults (kills, full disks, damage …) and compare digests; writes docs/faults.md (half an hour)
	@$(BIN)/python -m tests.faults --write docs/faults.md

fuzz: $(VENV)/installed-dev  ## feed a million wrong files to whatever reads files (half an hour)
	@$(BIN)/python -m tests.fuzz

bench-peers: $(PEERS)/installed $(PEERS)-tacto/installed simulate-touch.0  ## measure TACTO, Taxim, KeOps, HDF5 … beside ours; writes docs/peers.md
	@KEOPS_CACHE_FOLDER=$(abspath $(PEERS))/keops OMP_NUM_THREADS=1 $(PEERS)/bin/python -m benchmarks.peers --data $(DATA) --write docs/peers.md

# Most peers work with our package versions: their environment adds to $(VENV). TACTO needs other versions, in an environment of its own.
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

test-hands: $(HANDS)/installed  ## grasp MANIFEST's objects with seven hands of others, from wheels; contact sheets in data/hands (half an hour on 2 cores; MANIFEST=one-of-each: a fifth)
	@$(BIN)/python -m benchmarks.hands --manifest $(MANIFEST) --site-packages $(HANDS)/hands \
	    --site-packages "$$($(BIN)/python -c 'import site; print(site.getsitepackages()[0])')"

$(HANDS)/installed: $(VENV)/installed benchmarks/hands/requirements.txt
	@$(BIN)/pip install --quiet --disable-pip-version-check --no-deps --upgrade --target $(HANDS)/hands -r benchmarks/hands/requirements.txt
	@touch $@

# Blender needs an older numpy: an environment of its own, which is given scenes and gives pictures.
showcase: .venv-showcase/installed $(VENV)/installed  ## render ten grasps, a turntable and touch to shape with Blender: data/showcase (15 minutes on 2 cores)
	@$(BIN)/python -m tools.showcase $(DATA) data/showcase --blender .venv-showcase/bin/python

.venv-showcase/installed: | system
	@test -x .venv-showcase/bin/python || $(PYTHON) -m venv .venv-showcase
	@echo "installing Blender into .venv-showcase (400 MB)"
	@.venv-showcase/bin/pip install --quiet --disable-pip-version-check bpy==4.5.15
	@touch $@

clean:  ## remove the virtual environments; data is kept
	rm -rf $(VENV) .venv-peers .venv-peers-tacto $(HANDS) .venv-exports .venv-showcase
