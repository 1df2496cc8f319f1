# Tests on other systems, and measurements: targets for contributors. Included by the Makefile.

.PHONY: test-cpus test-extremes test-slow test-report test-exports test-docs test-slurm test-storage test-sensors test-hands site faults findings fuzz bench bench-before bench-grasps bench-gels bench-peers \
        bench-touch tradeoff weights gel-weights sensor-weights

PEERS_PYTHON := .venv-peers/bin/python
installed-browser installed-exports installed-peers installed-tactile-mnist installed-dexgraspbench: installed-dev

SHIPPED_SETTINGS := sample-distances.queries=6144 train-unet.epochs=1 train-unet.learning_rate=0.001 train-implicit.batch_size=8 train-implicit.features=192 \
         train-implicit.encoder_width=0.5 train-implicit.validation_items=6 train-implicit.validation_queries=1000 train-implicit.cache_megabytes=4000
learn  = $(MAKE) --no-print-directory train MANIFEST=$(1) DATA=data/$(1)/draft CONFIGURATIONS=implicit-any SEEDS=$(2) SET=$(call quoted,$(SHIPPED_SETTINGS) $(3) $(SET))
FURTHER_TRAINING := train-implicit.epochs=70 train-implicit.learning_rate=0.001 train-implicit.placement_error=0.006
# Resumed where it was killed, as all stages are: on 2 quiet cores an hour and a quarter for the data, then 100 epochs, a minute each on one core;
# then as long again for objects of more kinds, which the same network goes on to learn from, and from the same objects once more.
weights:  ## train the pretrained network for objects of half a metre, and the U-Net; measure them, and write both with a card (7 hours)
	@$(call learn,weights,0,train-implicit.epochs=100)
	@$(call learn,thirteen-classes,1,$(FURTHER_TRAINING) train-implicit.pretrained=data/weights/draft/models)
	@$(call learn,thirteen-classes,0,$(FURTHER_TRAINING) train-implicit.pretrained=data/thirteen-classes/draft/models/seed-1)
	@$(BIN)/python -m benchmarks.ship_weights data/thirteen-classes/draft

GEL_SETTINGS := simulate-grasps.hand=allegro_right_mini simulate-grasps.search=hold render-vision.scene=robot render-vision.resolution=192 \
         train-implicit.epochs=56 train-implicit.batch_size=8 train-implicit.learning_rate=0.002 train-implicit.near_touches=0.3 train-implicit.features=192 \
         train-implicit.encoder_width=0.5 train-implicit.validation_items=6 train-implicit.validation_queries=1000 train-implicit.image_gain=0.2 \
         train-implicit.image_shift=15 train-implicit.image_noise=3 train-implicit.cache_megabytes=4000
# On 2 cores 2 hours for the data, then 56 epochs, 2.3 minutes each on one core.
gel-weights: household  ## train the pretrained network for objects of 6 to 20 cm and any gel, measure it, and write it with a card (4 hours)
	@$(MAKE) --no-print-directory train MANIFEST=hand-sized-test DATA=data/hand-sized-test/draft CONFIGURATIONS=implicit-gels SET=$(call quoted,$(GEL_SETTINGS) $(SET))
	@$(BIN)/python -m benchmarks.ship_weights data/hand-sized-test/draft implicit-gels

sensor-weights: $$(if $$(REAL),installed-peers,setup)  ## train the networks that read photographs of shipped sensors; with REAL=FOLDER cards say how well (20 minutes)
	@OMP_NUM_THREADS=1 $(if $(REAL),$(PEERS_PYTHON),$(BIN)/python) -m benchmarks.ship_sensor_weights $(if $(REAL),--real $(call quoted,$(REAL)))

test-cpus: lint  ## run the tests as on older processors: without AVX-512, and without AVX2 and FMA
	@for name in haswell prescott; do \
	    echo "as on $$name"; OMP_NUM_THREADS=1 $(BIN)/python -m checks.processors $$name $(BIN)/pytest -n auto --dist loadfile --no-loadscope-reorder -m 'not slow' || exit 1; done
	@$(BIN)/pytest -n 0 checks/same_bytes.py

test-slow: lint  ## run the same tests at full size
	@$(PYTEST) --hypothesis-profile thorough tests checks/memory.py

test-extremes: installed-dev  ## feed kernels with the extremes of their ranges, against exact arithmetic; writes docs/extremes.md (5 minutes)
	@$(BIN)/python -m checks.extremes --write docs/extremes.md

test-report: installed-browser  ## click through a report in headless Chromium, with an accessibility checker; as root (4 minutes on 2 cores)
	@$(BIN)/pytest -n 0 checks/browser/report_in_browser.py

test-exports: installed-exports  ## read exports with LeRobot, Hugging Face, Croissant, WebDataset and tacstack, the store with tensorstore, zarrs, zarrita and xarray (5 minutes on 2 cores)
	@HF_HUB_OFFLINE=1 .venv-exports/bin/python -m pytest -n 0 checks/exports/read_back.py checks/exports/other_readers.py

findings:  ## show what surprised us in other software, each in an environment of its own: findings/README.md (5 minutes)
	@changed=0; for script in findings/*.sh; do \
	    echo "== $$script"; PYTHON=$(call quoted,$(PYTHON)) sh "$$script" || { echo "it has changed"; changed=1; }; done; exit "$$changed"

site: installed-docs  ## build the documentation as pages: site/index.html
	@NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --quiet --strict --site-dir site && echo "site/index.html"

test-docs: installed-dev site  ## check the pages' links, run the documents' commands and the notebook (half an hour on 2 cores)
	@$(BIN)/pytest -n 0 checks/documents/run_commands.py
	@$(BIN)/python -m checks.documents.run_notebook examples/first_steps.ipynb

test-slurm: installed-dev installed-slurm  ## install Slurm, start one of one node, and run all stages on it; as root (under 10 minutes on 2 cores)
	@$(BIN)/pytest -n 0 checks/slurm/real_slurm.py

test-storage: installed-dev  ## run all stages with their data on two servers of object storage, one killed again and again (4 minutes on 2 cores)
	@$(BIN)/pytest -n 0 checks/storage.py

test-sensors: installed-peers  ## test the shipped sensors on real photographs, beside Taxim; with REAL=FOLDER writes docs/sensors.md (3 minutes)
	@OMP_NUM_THREADS=1 $(PEERS_PYTHON) -m benchmarks.real_sensors --write docs/sensors.md $(if $(REAL),--real $(call quoted,$(REAL)))

test-hands: installed-hands  ## grasp MANIFEST's objects with the hands of others, from wheels; contact sheets in data/hands (over an hour on 2 cores; MANIFEST=one-of-each: a fifth)
	@$(BIN)/python -m benchmarks.hands --manifest $(call quoted,$(MANIFEST)) --site-packages .venv-hands/hands \
	    --site-packages "$$($(BIN)/python -c 'import sysconfig; print(sysconfig.get_path("purelib"))')"

faults: installed-dev  ## inject 600 faults (kills, full disks, damage …) and compare digests; writes docs/faults.md (an hour on 2 cores)
	@$(BIN)/python -m checks.faults --write docs/faults.md

fuzz: installed-dev  ## feed a million invalid files to all file readers (half an hour)
	@$(BIN)/python -m checks.fuzz

bench: installed-dev simulate-touch.0  ## measure every stage beside its raw limit, in one run
	@$(BIN)/python -m benchmarks surfaces vision depth presses chamfer gcn --data $(call quoted,$(DATA))

bench-before: setup  ## measure this checkout beside the commit BEFORE, in turns: seconds and memory of stages, images, predict, training, evaluate
	@$(if $(BEFORE),,echo "name the commit to compare with: make bench-before BEFORE=COMMIT"; exit 1)
	@$(BIN)/python -m benchmarks.before $(call quoted,$(BEFORE)) $(ROWS) $(if $(ROUNDS),--rounds $(call quoted,$(ROUNDS))) \
	    $(if $(filter override,$(origin DATA)),--data $(call quoted,$(DATA)))

bench-grasps: installed-dev $$(if $$(PUBLIC),installed-dexgraspbench,simulate-grasps.0)  ## test DATA's grasps in PyBullet and MuJoCo: lift, six directions, DexGraspBench; PUBLIC=FOLDER: those of a clone of DexGraspBench beside ours, in its own test too; writes docs/peers.md (an hour on 2 cores)
	@$(BIN)/python -m benchmarks.$(if $(PUBLIC),public_grasps $(call quoted,$(PUBLIC)) --write docs/peers.md,held_grasps $(call quoted,$(DATA)))

GELS     := gelsight_mini gelsight digit
HELD_GELS = --manifest benchmarks/held_gels.yaml --data data/held-gels/$(1) --set sample-surfaces.diagonal=0.15 \
            --set simulate-grasps.search=hold --set simulate-grasps.grasps=3 --set simulate-grasps.sensor=$(1)
bench-gels: installed-dev  ## measure depth, force and torque of elastic gels in grasps of eight objects of 15 cm, and the forces on the objects at rest
	@$(foreach gel,$(GELS),$(BIN)/vt-pipeline run sample-surfaces simulate-grasps $(call HELD_GELS,$(gel)) &&) \
	$(BIN)/python -m benchmarks.held_gels $(addprefix data/held-gels/,$(GELS))

bench-peers: installed-peers installed-tacto installed-tactile-mnist simulate-touch.0  ## measure TACTO, Taxim, tactile-mnist, KeOps, HDF5 … beside ours; writes docs/peers.md
	@KEOPS_CACHE_FOLDER="$$PWD/.venv-peers/keops" OMP_NUM_THREADS=1 $(PEERS_PYTHON) -m benchmarks --data $(call quoted,$(DATA)) --write docs/peers.md

bench-touch: installed-dev  ## score depth read in photographs of REAL=FOLDER, beside a look-up table; writes docs/real-touch.md (an hour)
	@$(if $(REAL),,echo "name the folder of the photographs: make bench-touch REAL=FOLDER (docs/real-touch.md says what to clone into it)"; exit 1)
	@$(BIN)/python -m benchmarks.real_touch $(call quoted,$(REAL)) --write docs/real-touch.md

tradeoff: installed-dev  ## measure what settings cost and how wrong they are; writes docs/tradeoff.md (half an hour on 2 cores)
	@$(BIN)/python -m benchmarks.tradeoff --write docs/tradeoff.md
