# The commands of everyday work. `make demo` and `make test` are all a fresh machine needs.
PYTHON ?= python3
PORT ?= 8000
DATA_DIR ?= data
VENV := .venv
BIN := $(VENV)/bin
# Packages are compiled when they are first used: most of what is in them never is.
PIP := $(BIN)/python -m pip install --quiet --no-compile --disable-pip-version-check --constraint constraints.txt

# Scripts of the pages are plain ES modules, without a package.json that says so.
NODE_TEST := node --experimental-default-type=module --test-force-exit --test

# As many processes as processors; one that has nothing left to do takes tests from another.
PYTEST := $(BIN)/python -m pytest --numprocesses logical --dist worksteal

# Otherwise every process would compile all its modules anew: twice the CPU time of an import.
unexport PYTHONDONTWRITEBYTECODE

.PHONY: demo test test-postgresql lint messages screenshots no-wait watching load chaos regret calibration bench fuzz clean
.DEFAULT_GOAL := demo

$(VENV)/.made:
	@$(PYTHON) -c 'import sys; sys.exit(f"Python 3.11 or newer is needed, {sys.executable} is {sys.version.split()[0]}: make PYTHON=/path/to/python3.11" if sys.version_info < (3, 11) else 0)'
	$(PYTHON) -m venv $(VENV)
	touch $@

# One stamp per set of packages: a second start installs nothing.
$(VENV)/.app: pyproject.toml constraints.txt | $(VENV)/.made
	$(PIP) --editable .
	touch $@

$(VENV)/.dev: pyproject.toml constraints.txt | $(VENV)/.made
	$(PIP) --editable '.[dev,postgresql]'
	touch $@ $(VENV)/.app

# The optimisers that ours is measured against: for `make bench` alone.
$(VENV)/.bench: pyproject.toml constraints.txt | $(VENV)/.made
	$(PIP) --editable '.[bench]'
	touch $@ $(VENV)/.app

demo: $(VENV)/.app
	@$(BIN)/pbpo demo --port $(PORT) --data-dir $(DATA_DIR)

# What PostgreSQL may do otherwise than SQLite is tested on both: constraints, locks, order of rows,
# transactions, migrations, workers. The other files are about pages, files and settings, and are the
# same on both; `make test-postgresql` runs them all.
DIFFERENT := answered_meanwhile any_order at_once backup changed_meanwhile deleted_studies entry_links forgetting jobs \
	killed leaving many_events older_databases places privacy restores_that_fail retention rollout_requests \
	rollout_supervision rows_in_any_order same_moment sent_twice serving session several_machines shared_models \
	store_and_workers task_queue trials_table undo waiting_writers work_polling workers
ON_POSTGRESQL := tests/unit/storage $(DIFFERENT:%=tests/functional/test_%.py)

# Videos that were rendered for one test serve all others: they are named by their content.
test: export PBPO_TEST_MEDIA_DIR ?= $(CURDIR)/build/test-media

# The browsers come last: nothing else should take the machine from them.
test: $(VENV)/.dev
	$(NODE_TEST) tests/js
	$(PYTEST) tests/unit tests/functional
	$(PYTEST) --database postgresql $(ON_POSTGRESQL)
	$(PYTEST) tests/browser

test-postgresql: export PBPO_TEST_MEDIA_DIR ?= $(CURDIR)/build/test-media
test-postgresql: $(VENV)/.dev
	$(PYTEST) --database postgresql tests/unit/storage tests/functional

lint: $(VENV)/.dev
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

# Every text of an evaluator's page into the catalogues, for translators: the new ones are empty.
messages: $(VENV)/.app
	@mkdir -p build
	@$(BIN)/pybabel --quiet extract --mapping pyproject.toml --keyword translatable --add-location file --sort-by-file --no-wrap --omit-header --output build/pbpo.pot .
	@$(BIN)/pybabel --quiet update --domain pbpo --input-file build/pbpo.pot --output-dir app/web/locale --no-fuzzy-matching --ignore-obsolete --no-wrap --ignore-pot-creation-date

# The pictures of docs/evaluator.md, taken of the pages as they are now.
screenshots: $(VENV)/.dev
	@$(BIN)/python -m tests.browser.take_screenshots

# How long evaluators wait for the next pair, in a real browser: about 20 minutes, on a machine that does nothing else.
no-wait: $(VENV)/.dev
	@$(BIN)/pbpo media render --environment env1 --media-dir media
	@$(BIN)/python -m tests.browser.measure_no_wait --media-dir media
	@$(BIN)/python -m tests.browser.measure_no_wait --media-dir media --queries 100 --look-s 6 --mbit-s 4

# How long the page of a study with 200 sessions takes to open, in a real browser.
watching: $(VENV)/.dev
	@$(BIN)/python -m tests.browser.measure_watching

# A crowd of evaluators, videos included, from 10 to 200 at once: about 6 minutes, on a machine that does nothing else.
load: $(VENV)/.dev
	@$(BIN)/python -m tests.load.measure --evaluators 10 50 100 200
	@$(BIN)/python -m tests.load.measure --evaluators 100 --postgresql --workers 2

# The server and machines killed, its database stopped, its disk full, and more, under a crowd: about 15 minutes.
chaos: $(VENV)/.dev
	@$(BIN)/python -m tests.load.chaos --times 20
	@$(BIN)/python -m tests.load.chaos --times 20 --workers 2 --only killed ended

# The regret of simulated evaluators over ranges, and over a list of candidates: about five minutes.
regret: $(VENV)/.dev
	@$(BIN)/python -m tests.load.machine_regret

calibration: $(VENV)/.app
	@$(BIN)/python -m app.crane.calibration

# Calls, forms, bodies near the limits and actions in any order, by chance, with a bound on memory: so many seconds for each part, then a table. FUZZ_SEED repeats a round.
FUZZ_SECONDS ?= 120
fuzz: $(VENV)/.dev
	$(BIN)/python -m pytest --fuzz $(FUZZ_SECONDS) $(if $(FUZZ_SEED),--fuzz-seed $(FUZZ_SEED)) $(addprefix tests/functional/test_, openapi.py hostile_forms.py heavy_bodies.py any_order.py)

bench: $(VENV)/.bench
	@$(BIN)/python -m app.lab.bench

clean:
	rm -rf $(VENV) build dist *.egg-info .mypy_cache .ruff_cache .pytest_cache .hypothesis
