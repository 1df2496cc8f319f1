# Makes datasets and trained models with vt-pipeline. `make` lists the targets and the variables below.
#
#   MANIFEST=toy      which objects: toy, one-of-each, procedural, four-classes, weights, thirteen-classes, hand-sized, hand-sized-test, pybullet-objects, household,
#                     directory, warehouse, single-image, or a YAML file
#   PRESET=draft      draft, standard or paper
#   DATA=...          data directory, or s3://BUCKET/PREFIX; by default data/MANIFEST/PRESET, or data/MANIFEST-OBJECTS/PRESET
#   OBJECTS=...       folder of meshes, for manifests that name none
#   UNITS=mm UP=y     unit and up-axis of OBJECTS' files, to keep real sizes; by default what glTF, COLLADA and 3MF state; others: 0.5 m, z up
#   GRASPS=...        simulate-grasps, or read-grasps for your own files: GRASPS=read-grasps SET="read-grasps.folder=FOLDER"
#   SET="..."         settings: SET="simulate-grasps.attempts=20 simulate-touch.tracer=sphere", no value with a blank (vt-pipeline --set takes it)
#   SHARDS=...        shards the objects are split into; by default the number that the dataset has, 1 for a new one
#   WORKERS=0         processes per shard; 0 is one per core (1 where `make -j` runs several shards at a time)
#   CONFIGURATIONS="none touch occluded occluded-touch unoccluded unoccluded-touch"
#                     graph networks to train and evaluate; images or touches that none of them uses are not made;
#                     implicit-touch, implicit-occluded, implicit-occluded-touch, implicit-unoccluded, implicit-unoccluded-touch too;
#                     implicit-any takes any of this; implicit-any-touch and its like are single rows of it;
#                     implicit-gels too, with touches of any sensor in place of touch charts
#   SEEDS=0           trainings of each network, and evaluations of them: SEEDS="0 1 2" shows what is chance
#   REAL=...          folder of clones of public repositories with photographs, for bench-touch and test-sensors: see docs/real-touch.md
#   LONG=1            for reproduce: a night on 2 cores
#   PUBLIC=...        clone of JYChen18/DexGraspBench with its submodule, for bench-grasps: its grasps beside ours
#   BEFORE=COMMIT     for bench-before: what is measured beside this checkout; ROWS="grasps touch" and ROUNDS=3 make it shorter
#   PYTHON=...        Python 3.11, 3.12 or 3.13 for the virtual environment VENV=.venv; by default the first that fits, or one that uv downloads

.DEFAULT_GOAL := help
.SECONDEXPANSION:  # of prerequisites: $$(…) is looked at when a target is made, so that `make help` reads no dataset
.SUFFIXES:
MAKEFLAGS += --no-builtin-rules

# ---- Values. They are taken as they are: make expands nothing in them, and `quoted` keeps the shell from it. Recipes hold no line breaks.

VARIABLES := MANIFEST PRESET DATA OBJECTS UNITS UP GRASPS SET SHARDS WORKERS CONFIGURATIONS SEEDS LONG REAL PUBLIC BEFORE ROWS ROUNDS VENV PYTHON
define newline


endef
comma   := ,
space   := $(subst ,, )
# functions of file names split at blanks
blank   := <blank>
filled   = $(subst $(space),$(blank),$(1))
last-name = $(notdir $(call filled,$(abspath $(call filled,$(1)))))
quoted   = '$(subst ','\'',$(1))'

$(foreach name,$(VARIABLES),$(if $(findstring $(newline),$(value $(name))),$(error $(name) has a line break; write it on one line)))
$(foreach name,$(VARIABLES),$(if $(filter-out undefined,$(origin $(name))),$(eval override $(if $(value $(name)),$(name) := $$(value $(name)),undefine $(name)))))

unknown := $(strip $(foreach name,$(.VARIABLES),$(if $(filter command,$(firstword $(origin $(name)))),$(filter-out $(VARIABLES),$(name)))))
$(foreach name,$(unknown),$(eval unexport $(subst $$,,$(name))))  # make 4.4 expands what it exports to `shell`
$(if $(unknown),$(error there is no variable $(firstword $(unknown)); there are $(VARIABLES)))

no-digits = $(subst 0,,$(subst 1,,$(subst 2,,$(subst 3,,$(subst 4,,$(subst 5,,$(subst 6,,$(subst 7,,$(subst 8,,$(subst 9,,$(1)))))))))))
$(if $(strip $(call no-digits,$(SEEDS))),$(error SEEDS is $(SEEDS); it must be whole numbers, such as SEEDS="0 1 2"))
$(if $(filter-out x x1,x$(LONG)),$(error LONG is $(LONG); it must be 1, or left out))

MANIFEST ?= toy
PRESET   ?= draft
DATA     ?= $(subst $(blank),$(space),data/$(basename $(notdir $(call filled,$(MANIFEST))))$(if $(OBJECTS),-$(call last-name,$(OBJECTS)))/$(PRESET))
CONFIGURATIONS ?= none touch occluded occluded-touch unoccluded unoccluded-touch
SEEDS    ?= 0
GRASPS   ?= simulate-grasps
$(if $(filter simulate-grasps read-grasps,$(GRASPS)),,$(error GRASPS is $(GRASPS); it must be simulate-grasps or read-grasps))
VENV     ?= .venv
# `make -j` works on several shards at a time, with one core each; otherwise the objects of one shard share all cores.
WORKERS  ?= $(if $(and $(filter -j%,$(MAKEFLAGS)),$(filter-out 0 1,$(words $(SHARD_NUMBERS)))),1,0)

BIN      := $(call quoted,$(VENV)/bin)
INSTALL  := sh tools/install.sh $(call quoted,$(VENV)) $(call quoted,$(PYTHON))

# 0 1 2 …, as many as SHARDS or else the dataset says; nothing where neither does. Found once, when it is first asked for.
SHARD_NUMBERS = $(eval SHARD_NUMBERS := $$(shell sh tools/shards.sh $$(call quoted,$$(DATA)) $$(call quoted,$$(SHARDS)) $$(call quoted,$$(VENV))))$(if \
                $(filter 0,$(.SHELLSTATUS)),,$(error the number of shards is not known; see the message above))$(SHARD_NUMBERS)

options  = --manifest $(call quoted,$(MANIFEST)) --preset $(call quoted,$(PRESET)) --data $(call quoted,$(DATA)) \
           $(if $(OBJECTS),--objects $(call quoted,$(OBJECTS))) $(if $(UNITS),--units $(call quoted,$(UNITS))) $(if $(UP),--up $(call quoted,$(UP))) \
           $(foreach one,$(SET),--set $(call quoted,$(one))) --workers $(call quoted,$(WORKERS)) \
           $(if $(SHARD_NUMBERS),--shards $(words $(SHARD_NUMBERS)))$(if $(filter train evaluate report,$(MAKECMDGOALS))$(asked), $(checked))
asked   := $(filter override,$(origin CONFIGURATIONS))
checked  = --set $(call quoted,$(EVALUATED))  # so that a misspelt network stops the first stage, not the last
run      = $(BIN)/vt-pipeline run $(call quoted,$(1)) $(options)
RUN      = $(call run,$@)
SHARD    = $(call run,$(basename $@)) --shard $(call quoted,$(subst .,,$(suffix $@)))

.PHONY: help setup household dataset summary train-unet train-touch train evaluate report reproduce train-single-image evaluate-single-image single-image \
        renderings docs lint test clean FORCE
FORCE:

help:  ## list the targets
	@echo "targets:"; grep -hE '^[a-z-]+:.*## ' $(MAKEFILE_LIST) | awk -F ':.*## ' '{printf "  make %-16s %s\n", $$1, $$2}'
	@echo; echo "variables:"; sed -n 's/^#   /  /p' $(firstword $(MAKEFILE_LIST))

dataset: summary  ## make the dataset, print its statistics and draw its contact sheets

# the stages of a shard of the dataset, in one process: starting takes longer than finding that all is up to date
DATASET := sample-surfaces $(GRASPS) render-vision simulate-touch
dataset.%: setup FORCE
	@$(BIN)/vt-pipeline run $(DATASET) $(options) --shard $(call quoted,$*)

# ---- The stages: one target per stage and shard. Each is always run: vt-pipeline itself knows what is up to date.
# tests/test_makefile.py checks that the prerequisites are the stages' inputs.

# every shard of a stage
every-%: $$(addprefix $$*.,$$(or $$(SHARD_NUMBERS),0)) ;

sample-surfaces.%: setup FORCE
	@$(SHARD)
simulate-grasps.%: sample-surfaces.%
	@$(SHARD)
read-grasps.%: sample-surfaces.%
	@$(SHARD)
render-vision.%: $(GRASPS).%
	@$(SHARD)
simulate-touch.%: $(GRASPS).%
	@$(SHARD)
simulate-presses.%: sample-surfaces.%
	@$(SHARD)
simulate-slides.%: sample-surfaces.%
	@$(SHARD)
sample-distances.%: sample-surfaces.%
	@$(SHARD)
train-unet: every-simulate-touch  ## train the U-Net that predicts depth from tactile images
	@$(RUN)
train-touch: every-simulate-presses  ## train the network that reads photographs from simulated presses
	@$(RUN)
fit-charts.%: train-unet
	@$(SHARD)

# train-gcn.touch.1 is the training of the network `touch` with seed 1
TRAINING  = $(call run,$(1)) --set $(call quoted,$(1).configuration=$(basename $*)) --set $(call quoted,$(1).training_seed=$(subst .,,$(suffix $*)))
train-gcn.%: every-sample-surfaces $$(if $$(findstring occluded,$$*),every-render-vision) $$(if $$(findstring touch,$$*),every-fit-charts)
	@$(call TRAINING,train-gcn)
train-implicit.%: every-sample-surfaces every-sample-distances \
                 $$(if $$(findstring occluded,$$*)$$(findstring -any,$$*)$$(findstring -gels,$$*),every-render-vision) \
                 $$(if $$(findstring touch,$$*)$$(findstring -any,$$*),every-fit-charts) $$(if $$(findstring -gels,$$*),every-simulate-touch)
	@$(call TRAINING,train-implicit)

FAMILIES  = implicit
# networks called FAMILY-… are trained by train-FAMILY, all others by train-gcn
# implicit-any-touch and its like are rows of the one network implicit-any, those of implicit-gels too
NETWORKS  = $(foreach name,$(sort $(patsubst implicit-gels-%,implicit-gels,$(patsubst implicit-any-%,implicit-any,$(CONFIGURATIONS)))),$(firstword $(foreach family,$(FAMILIES),$(if $(filter $(family)-%,$(name)),train-$(family).$(name))) train-gcn.$(name)))
EVALUATED = evaluate.configurations=[$(subst $(space),$(comma),$(strip $(CONFIGURATIONS)))]
train: $$(foreach seed,$$(SEEDS),$$(addsuffix .$$(seed),$$(NETWORKS)))  ## train these networks, and the U-Net for those that use touch
evaluate.%: $$(addsuffix .$$*,$$(NETWORKS)) every-$(GRASPS)
	@$(call run,evaluate) --set $(call quoted,evaluate.training_seed=$*) --set $(call quoted,$(EVALUATED))
evaluate: $$(addprefix evaluate.,$$(SEEDS))  ## evaluate these networks on the test objects, beside the supplement's tables
	@$(BIN)/vt-pipeline report $(call quoted,$(DATA)) --no-pages
report: every-simulate-touch $$(addprefix evaluate.,$$(SEEDS))  ## check the supplement's orderings; write pages with gallery, figures and tables: DATA/report/index.html
	@$(BIN)/vt-pipeline report $(call quoted,$(DATA)) --shipped

# what `reproduce` sets itself
FIXED    := MANIFEST PRESET SEEDS OBJECTS
$(if $(filter reproduce,$(MAKECMDGOALS)),$(foreach name,$(FIXED),$(if $(filter override,$(origin $(name))),$(error reproduce has its own $(name); leave it out))))
# LONG=1: graph networks with thirteen times the epochs, and implicit ones with five times, a night on 2 cores; killed, it continues where it was.
FOUR      = MANIFEST=four-classes PRESET=draft CONFIGURATIONS=$(call quoted,$(CONFIGURATIONS)$(if $(LONG), implicit-occluded-touch implicit-unoccluded)) \
            DATA=$(call quoted,$(if $(filter override,$(origin DATA)),$(DATA),data/four-classes/$(if $(LONG),long,draft))) \
            SET=$(call quoted,$(if $(LONG),train-gcn.epochs=80 train-implicit.epochs=500,evaluate.grasps=[1$(comma)5]) $(SET))
reproduce:  ## test the supplement's claims on 240 procedural objects, its networks with three seeds each (LONG=1: overnight, implicit ones too)
	@began=$$(date +%s); $(MAKE) --no-print-directory summary $(FOUR) && made=$$(date +%s) && \
	$(MAKE) --no-print-directory -j$$(nproc) report SEEDS="0 1 2" $(FOUR) && \
	echo "dataset: $$(((made - began) / 60)) min; training, evaluation and report: $$((($$(date +%s) - made) / 60)) min on $$(nproc) cores"

.PRECIOUS: every-% sample-surfaces.% sample-distances.% read-renderings.% read-grasps.% simulate-grasps.% render-vision.% simulate-touch.% simulate-presses.% simulate-slides.% fit-charts.% dataset.% \
           train-gcn.% train-implicit.% evaluate.%

summary: every-dataset  ## the statistics and contact sheets alone
	@$(BIN)/vt-pipeline summary $(call quoted,$(DATA))

# ---- The supplement's last experiment (3.6): renderings of objects from all sides, one image each

read-renderings.%: sample-surfaces.%
	@$(SHARD)
train-single-image: every-sample-surfaces every-read-renderings
	@$(RUN)
evaluate-single-image: train-single-image
	@$(RUN)
single-image: evaluate-single-image  ## reconstruct from single images (Table 4), of MANIFEST=single-image OBJECTS=FOLDER
	@$(BIN)/vt-pipeline report $(call quoted,$(DATA)) --no-pages
renderings: every-sample-surfaces  ## write the objects of MANIFEST=four-classes as such a folder, data/renderings: meshes, and 24 images of each
	@$(BIN)/python -m tools.synthetic_renderings $(call quoted,$(DATA)) data/renderings

# ---- Installation, documents and tests; tools/install.sh knows what is there already

setup:  ## install system libraries and, into .venv, pinned packages
	@$(INSTALL) project

installed-%: setup FORCE
	@$(INSTALL) $(call quoted,$*)

household: installed-household  ## install sweethome3d-furniture, and unpack its 820 models for MANIFEST=household; as root (120 MB)

docs: setup  ## regenerate the reference pages in docs: arrays, settings, manifests, hands, sensors, observations
	@$(BIN)/python -m tools.reference_pages docs

lint: installed-dev  ## check style, types and import directions
	@$(BIN)/ruff check . && $(BIN)/ruff format --check . && $(BIN)/mypy && $(BIN)/lint-imports --no-cache

# One thread per process: as many processes as cores run the tests, file by file in the order of tests/conftest.py.
PYTEST   := OMP_NUM_THREADS=1 $(BIN)/pytest -n auto --dist loadfile --no-loadscope-reorder --durations=20
test: lint  ## run the tests, among them a few objects through every stage (under 10 minutes on 2 cores)
	@$(PYTEST) -m 'not slow'

clean:  ## remove the virtual environments; data is kept
	@$(INSTALL) remove

include tools/development.mk
