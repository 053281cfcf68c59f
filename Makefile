# Each target sets itself up: nothing is needed but Python 3.10+, pip and make.
# `make PYTHON=python3.12 test` chooses the interpreter of a new .venv, and `make CLUSTER=auto results` plays the episodes
# on a cluster of Ray (docs/cluster.md).

PYTHON  ?= python3
WORKERS ?= 2
CLUSTER ?=
ON      := $(if $(CLUSTER),--cluster $(CLUSTER))
VENV    := .venv
RUN     := $(VENV)/bin/python
PIP     := $(RUN) -m pip --disable-pip-version-check install --quiet

POLICIES := generalist ppo ppo-entropy random stay sweep best-constant best-sequence mi-constant mi-mi mi-fisher fisher-fisher variance-reduction joint-mi lookahead-2 greedy-plus
CLIENTS := sb3 torchrl rllib cleanrl rerun live gtsam cluster

.DEFAULT_GOAL := help
.DELETE_ON_ERROR:
.PHONY: help demo consistency learners generalist curves leaderboard results figures advice bench clients client-figures clips docs test pytest test-oldest test-newest lint clean $(CLIENTS:%=client-%)

help: ## show this list
	@awk -F ':.*## ' '/^[a-z-]+:.*## /{printf "  make %-14s %s\n", $$1, $$2}' Makefile

demo: $(VENV)/.agents ## compare learned and greedy policies in eight episodes: table, pictures and an animation in results/demo
	$(RUN) -m agents compare --policies ppo best-constant mi-constant mi-mi mi-fisher --episodes 8 --seed 1000000 --out results/demo
	$(RUN) -m agents watch --policies ppo mi-fisher --seed 1000000 --save results/demo/episode.gif

consistency: $(VENV)/.demo ## is the filter consistent? 100 episodes of each policy and variant (minutes): docs/consistency.md
	$(RUN) -m studies.consistency --episodes $(or $(EPISODES),100) --jobs $(WORKERS) $(ON) --out results/consistency --report docs/consistency.md

consistency leaderboard results figures advice: $(if $(CLUSTER),$(VENV)/.cluster)

# SUITE: that the leaderboard shows. EPISODES: episodes of each study, for a trial; without bench.
SUITE    := v4
ENTRIES  := best-constant best-sequence sweep orbit random stay mi-mi mi-fisher joint-mi greedy-plus
BOARD    := $(if $(EPISODES)$(filter development,$(SUITE)),results/entries,agents/suite/entries)
PLAYED   := --suite $(SUITE) $(if $(EPISODES),--episodes $(EPISODES))

# The learners of Stable-Baselines3 in the scenarios of the suite; their weights lie in the entries' folders.
LEARNERS := ppo-quick a2c-quick dqn-quick sac-quick ppo-full dqn-full a2c-full
SEEDS    := 0 1 2 3 4
TRAINED  := $(foreach one,$(LEARNERS),$(SEEDS:%=$(one)-%))
ASKING   := office+corridor+corner+sprint+noisy+clusters+rooms+gallery-pixels+corner-pixels
LEARNED  := --scenario $(ASKING) --test-episodes 0
QUICK    := --reward log_score --num-envs 4 --total-steps 40000 --validation-episodes 8
FULL     := --recipe full --num-envs 8 --period 40000 --validation-episodes 24

learners: $(VENV)/.agents ## train five seeds of each learner again (about six hours; the same command goes on): weights of their entries, and their curves
	printf '%s\n' $(TRAINED) | OMP_NUM_THREADS=1 NUMBA_NUM_THREADS=1 xargs -P $(WORKERS) -I NAME sh -c 'name=NAME; \
		case $$name in *-full-*) budget="$(FULL)";; *) budget="$(QUICK)";; esac; \
		exec $(RUN) -m agents train --algorithm $${name%%-*} --seed $${name##*-} $$budget $(LEARNED) --out results/learners/$$name'
	for name in $(TRAINED); do for suffix in npz json; do \
		cp results/learners/$$name/policy.$$suffix agents/suite/entries/$${name%-*}/policy-$${name##*-}.$$suffix || exit 1; \
	done; done
	$(RUN) -m studies.learning --folders results/learners/*-full-* --policies greedy-plus generalist --episodes 24 \
		--jobs $(WORKERS) --out results/learning
	cp results/learning/learning.png docs/images/learners.png

OLDER := agents/suite/entries/generalist

generalist: $(VENV)/.agents ## teach `generalist` again by its predecessors (forty minutes): five seeds in results/generalist
	mkdir -p results/generalist
	git archive fd182b9 $(OLDER) | tar -x -C results/generalist
	printf '%s\n' $(SEEDS) | OMP_NUM_THREADS=1 NUMBA_NUM_THREADS=1 xargs -P $(WORKERS) -I SEED \
		$(RUN) -m studies.imitation --seed SEED --actors results/generalist/$(OLDER)/policy-?.npz --out results/generalist/SEED

CURVES := $(SEEDS:%=office/%) $(foreach seed,0 1 2,clusters/$(seed) rooms/$(seed))
CURVE  := $(RUN) -m agents train --test-episodes 0 --recipe

curves: $(VENV)/.agents ## learning curves in three scenarios, and how much is left in two (three hours): docs/policies.md
	for one in $(CURVES); do scenario=$${one%/*}; seed=$${one#*/}; out=results/curves/$$scenario; \
		$(CURVE) quick --scenario $$scenario --seed $$seed --out $$out/quick-$$seed || exit 1; \
		$(CURVE) quick --initial generalist --learning-rate 3e-4 --entropy-bonus 0.002 \
			--scenario $$scenario --seed $$seed --out $$out/initial-$$seed || exit 1; \
	done
	for scenario in office clusters; do \
		$(CURVE) full --scenario $$scenario --seed 0 --out results/curves/$$scenario/full-0 || exit 1; \
	done
	$(RUN) -m studies.learning --folders results/curves --jobs $(WORKERS) --out results/curves-played --report docs/policies.md
	$(RUN) -m studies.upper_reference --jobs $(WORKERS) --out results/curves-played --report docs/policies.md

leaderboard: $(VENV)/.agents $(VENV)/.advice ## play the test episodes of the suite, and make its page (hours; what is of this BEHAVIOUR already stays; with EPISODES=8 twenty minutes)
	for policy in $(ENTRIES); do $(RUN) -m agents enter --name $$policy --policies $$policy $(PLAYED) $(ON) --out $(BOARD) || exit 1; done
	$(RUN) -m agents enter --name generalist --policies agents/suite/entries/generalist/policy-?.npz \
		--note "imitates dqn-full and older policies in 17 scenarios (DAgger); their training is not counted" $(PLAYED) $(ON) --out $(BOARD)
	for one in $(LEARNERS); do \
		$(RUN) -m agents enter --name $$one --policies agents/suite/entries/$$one/policy-?.npz \
			--note "$${one%-*} of Stable-Baselines3, in the suite's scenarios" $(PLAYED) $(ON) --out $(BOARD) || exit 1; \
	done
	$(RUN) -m agents leaderboard $(PLAYED) --entries $(BOARD) --report docs/leaderboard.md README.md

results: leaderboard ## the generated sections of the pages and their pictures, but for `curves` and studies.worth (hours; the same command goes on)
	$(RUN) -m agents compare --policies $(POLICIES) --reference best-constant --episodes $(or $(EPISODES),200) --out results/compare --report RESULTS.md --resume $(ON)
	$(RUN) -m docs.tables
	$(MAKE) consistency figures $(if $(EPISODES),,bench)

figures: $(VENV)/.advice ## the paper's claims and figures, and the live system (half an hour): docs
	$(RUN) -m studies.paper --episodes $(or $(EPISODES),100) --jobs $(WORKERS) $(ON) --out results/paper --report docs/paper.md
	$(MAKE) advice

advice: $(VENV)/.advice ## is the live page's advice worth following? 44 episodes (a quarter of an hour on two cores): docs/live.md
	$(RUN) -m studies.live --episodes $(or $(EPISODES),44) --long $(or $(EPISODES),14) --seed 5000006 --jobs $(WORKERS) $(ON) --out results/live --report docs/live.md

bench: $(VENV)/.bench ## how fast is it, beside others in the same run (10 minutes): results/bench
	$(RUN) -m benchmarks --out results/bench --report docs/BENCHMARKS.md

docs: $(VENV)/.docs ## the manual, in results/site, to be opened as a file; a warning is an error
	NO_MKDOCS_2_WARNING=1 $(RUN) -m mkdocs build --quiet --strict
	@echo "Open file://$(CURDIR)/results/site/index.html in a browser,"
	@echo "or serve it: $(RUN) -m http.server --directory results/site 8000, and open http://localhost:8000"

clips: $(VENV)/.agents ## a clip of each policy for the leaderboard: docs/images/clips
	@mkdir -p docs/images/clips
	for policy in $(POLICIES); do $(RUN) -m agents watch --policies $$policy --seed 1000111 --gaze-period 0.25 --width 480 --every 1 \
		--save docs/images/clips/$$policy.gif || exit 1; done

# mypy has one process: it runs beside the tests.
test: $(VENV)/.dev ## lint, every test but the slow ones, and the notebooks
	$(MAKE) --jobs 2 lint pytest

# Kernels are compiled once, on all cores, before the workers begin, which would compile the same ones. What Numba warns
# of is an error.
pytest: $(VENV)/.dev
	printf '%s\n' steps scores images | xargs -P $(WORKERS) -I KERNELS $(RUN) -c 'import warnings; \
		from numba.core.errors import NumbaWarning; warnings.simplefilter("error", NumbaWarning); \
		from activeslam_gym.envs import compiling; compiling.KERNELS()'
	NOTEBOOK_STEPS=2240 NOTEBOOK_ROOMS=2 NOTEBOOK_SECONDS=10 OMP_NUM_THREADS=1 $(RUN) -m pytest -n $(WORKERS) --dist worksteal --nbmake --nbmake-timeout=300 tests notebooks

test-oldest: ## the tests without those of learning, with the lowest versions that pyproject.toml allows and Python 3.10, if installed (10 minutes or more)
test-newest: ## the same with the newest releases and Python 3.14 or 3.13, if installed
test-oldest test-newest: test-%: .venvs/%/.made
	OMP_NUM_THREADS=1 .venvs/$*/bin/python -m pytest -n $(WORKERS) --dist worksteal tests

ALONE := OMP_NUM_THREADS=1

clients: $(CLIENTS:%=client-%) ## other people's learners, each in an environment under .venvs (minutes; client-sb3: one)

$(CLIENTS:%=client-%): client-%: .venvs/%/.made
	OMP_NUM_THREADS=1 .venvs/$*/bin/python -m pytest -m '' $(TESTS_$*)

client-figures: $(addprefix .venvs/,$(addsuffix /.made,sb3 torchrl rllib cleanrl)) ## does each library learn? (ten minutes): the figures of docs/clients.md
	for learner in PPO A2C DQN RecurrentPPO MaskablePPO; do $(ALONE) .venvs/sb3/bin/python examples/sb3.py $$learner || exit 1; done
	$(ALONE) .venvs/sb3/bin/python examples/rl_zoo3/train.py
	for library in torchrl rllib cleanrl; do $(ALONE) .venvs/$$library/bin/python examples/$${library}_ppo.py || exit 1; done

lint: $(VENV)/.dev ## ruff (lint and format) and mypy
	$(RUN) -m ruff check .
	$(RUN) -m ruff format --check .
	$(RUN) -m mypy

clean: ## remove what the targets made (not results/)
	rm -rf $(VENV) .venvs build dist *.egg-info .pytest_cache .mypy_cache .ruff_cache .hypothesis
	find . -name __pycache__ -type d -prune -exec rm -rf {} +

# Stamps: a set of packages is installed anew when pyproject.toml changes.

$(VENV)/.made:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 10) and "Python 3.10 or newer is needed: make PYTHON=python3.12 ...")'
	@echo "Making $(VENV) with $$($(PYTHON) --version)"
	@$(PYTHON) -m venv $(VENV)
	@$(PIP) 'pip>=23'
	@touch $@

$(VENV)/.demo: pyproject.toml | $(VENV)/.made
	@echo "Installing what the comparison needs into $(VENV) (once)"
	@$(PIP) --editable '.[compare]'
	@touch $@

$(VENV)/.advice: pyproject.toml | $(VENV)/.made
	@echo "Installing what the live study needs into $(VENV) (once)"
	@$(PIP) --editable '.[compare,vision]'
	@touch $@

$(VENV)/.agents: pyproject.toml | $(VENV)/.made
	@echo "Installing what learned policies need, PyTorch among it, into $(VENV) (once; takes a minute or two)"
	@$(PIP) --editable '.[agents]'
	@touch $@

$(VENV)/.cluster: pyproject.toml | $(VENV)/.made
	@echo "Installing Ray's core into $(VENV) (once)"
	@$(PIP) --editable '.[cluster]'
	@touch $@

$(VENV)/.bench: pyproject.toml | $(VENV)/.made
	@echo "Installing what the benchmark needs into $(VENV) (once)"
	@$(PIP) --editable '.[bench,vision]'
	@touch $@

$(VENV)/.docs: pyproject.toml | $(VENV)/.made
	@echo "Installing what the manual needs into $(VENV) (once)"
	@$(PIP) --editable '.[docs]'
	@touch $@

$(VENV)/.dev: pyproject.toml | $(VENV)/.made
	@echo "Installing what the tests need, PyTorch among it, into $(VENV) (once; takes a few minutes)"
	@$(PIP) --editable '.[agents,compare,dev,docs,mesh,notebooks,plot,vision]'
	@touch $@

# Each client has its own environment, since their pins disagree: RLlib's gymnasium, CleanRL's gym and NumPy.

TORCH := 'torch>=2.8,<2.14'

PACKAGES_sb3     := --editable '.[agents]' sb3-contrib rl_zoo3
PACKAGES_torchrl := --editable . $(TORCH) 'torchrl>=0.14'
PACKAGES_rllib   := --editable '.[compare]' $(TORCH) 'ray[rllib]==2.60.0'
PACKAGES_cleanrl := --editable . $(TORCH) 'gym==0.23.1' 'numpy<2' 'setuptools<81' tensorboard
PACKAGES_rerun   := --editable '.[rerun]'
PACKAGES_live    := --editable '.[live]' playwright # drives the system's own chromium; it downloads none
PACKAGES_gtsam   := --editable '.[compare,dev,gtsam]'
PACKAGES_cluster := --editable '.[agents,cluster]'
PACKAGES_oldest  := --editable '.[compare,dev,vision]' --constraint .venvs/lowest.txt
PACKAGES_newest  := --editable '.[compare,dev,vision]' --upgrade --upgrade-strategy eager

TESTS_sb3     := tests/test_clients.py -k sb3
TESTS_torchrl := tests/test_clients.py -k torchrl
TESTS_rllib   := tests/test_clients.py -k rllib
TESTS_cleanrl := tests/test_clients.py -k cleanrl
TESTS_rerun   := tests/test_examples.py -k rerun
TESTS_live    := tests/live tests/vision/test_board.py
TESTS_cluster := tests/evaluation/test_cluster.py
TESTS_gtsam   := tests/test_smoother.py

.venvs/lowest.txt: pyproject.toml # each lower bound as the one version
	@mkdir -p .venvs
	@grep -oE '"[A-Za-z0-9_-]+(\[[a-z]+\])?>=[0-9][0-9A-Za-z.]*' $< | sed -E 's/"([A-Za-z0-9_-]+).*>=/\1==/' | sort -u > $@

.venvs/oldest/.made: .venvs/lowest.txt
# The first of these interpreters that runs; `make PYTHON=...` overrules it.
first_of = $(shell for python in $(1); do $$python -c 'import sys; print(sys.executable)' 2>/dev/null && break; done)
.venvs/oldest/.made: PYTHON = $(call first_of,python3.10 python3)
.venvs/newest/.made: PYTHON = $(call first_of,python3.14 python3.13 python3)

.venvs/%/.made: pyproject.toml
	@echo "Installing what $* needs into .venvs/$* (once)"
	@$(PYTHON) -m venv .venvs/$*
	@.venvs/$*/bin/python -m pip --disable-pip-version-check install --quiet 'pip>=23'
	@.venvs/$*/bin/python -m pip --disable-pip-version-check install --quiet pytest $(PACKAGES_$*)
	@# CleanRL's own requirements are of 2023 (Python < 3.11, pygame, wandb); its ppo.py needs what stands above.
	@if [ $* = cleanrl ]; then .venvs/cleanrl/bin/python -m pip --disable-pip-version-check install --quiet \
		--no-deps --ignore-requires-python cleanrl==1.2.0; fi
	@touch $@
