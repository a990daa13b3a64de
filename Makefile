# Two commands on a machine with Python 3.11+, venv and make: `make run`, `make test`.

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
PIP := $(BIN)/pip install --quiet --disable-pip-version-check --constraint .ci/constraints.txt

.PHONY: run test lint types arrows compiled fast thorough slow browser test-vcan release bars paper peers prove prove-quick score score-diagnosis bench-commission bench-diagnose bench-estimator bench-export-c bench-http bench-links bench-faults bench-first-start bench-flash bench-history bench-idle bench-kills bench-load bench-mechanics bench-recordings bench-stale bench-plant bench-watch auto-window tuned-numbers gallery results picture clean

run: $(VENV)/.run ## emulated drive, service and page; Ctrl-C ends them; PORT=8081 beside another one
	@exec $(BIN)/pmsm-bench up $(PORT:%=--port %)

test: $(VENV)/.run ## every check but the families below, with the thirty longest
	@echo "lint, types, arrows and compiling: two minutes the first time"
	@$(MAKE) --no-print-directory --jobs 4 --output-sync=target lint types arrows compiled
	@$(MAKE) --no-print-directory fast

lint: $(VENV)/.dev
	$(BIN)/ruff check .

types: $(VENV)/.dev
	$(BIN)/basedpyright

arrows: $(VENV)/.dev
	$(BIN)/lint-imports --no-logo

compiled: $(VENV)/.run # once, what tests in several processes would each compile for themselves
	$(BIN)/python -m tests.bars.compiled

# Some wait for links, drives and services in real time: what others hold up for too long is tried once more alone
OTHERS := not browser and not vcan and not peers
TESTS = $(BIN)/pytest -o cache_dir=.pytest_cache/$(1) -m "$(2) and $(OTHERS)" --numprocesses $(3) --dist $(4) || \
	$(BIN)/pytest -o cache_dir=.pytest_cache/$(1) -m "$(2) and $(OTHERS)" --last-failed --last-failed-no-failures none
# Others cost every process their import
THOROUGH = $(shell grep --recursive --files-with-matches mark.thorough tests --include=test_*.py)

fast: $(VENV)/.dev
	$(call TESTS,fast,not slow and not thorough,4,loadfile --durations 30 --ignore tests/browser --ignore tests/peers)

thorough: $(VENV)/.dev ## files that take many seconds each: physics by many recordings, whole services
	$(call TESTS,thorough,not slow and thorough,4,loadfile $(THOROUGH))

slow: $(VENV)/.dev ## tests that take long
	$(call TESTS,slow,slow and not live,2,worksteal)
	$(BIN)/pytest -m "slow and live and $(OTHERS)"

release: test thorough browser slow test-vcan paper peers prove score bars ## all of it: a night

bars: bench-commission bench-diagnose bench-estimator bench-export-c bench-http bench-links bench-faults bench-first-start bench-flash bench-history bench-idle bench-kills bench-load bench-mechanics bench-recordings bench-stale bench-plant bench-watch ## what is measured by name

browser: $(VENV)/.dev ## the page in Chromium (Debian: chromium, chromium-driver)
	$(BIN)/pytest -m browser

test-vcan: $(VENV)/.dev ## CANopen over SocketCAN, in an emulated machine (Debian: qemu-system-x86, busybox-static, can-utils)
	$(BIN)/python -m tests.vcan

paper: $(VENV)/.dev ## the published experiment, reproduced: table and figures in build/paper
	$(BIN)/python -m tests.paper

peers: $(VENV)/.dev ## the emulated drive beside motulator and gym-electric-motor: tables and figures in build/peers
	$(BIN)/python -m tests.peers
	$(BIN)/pytest -m peers

results: $(VENV)/.dev ## tests/proof/RESULTS.md of the figures that were recorded; a command that measures records its own with RECORD=1
	$(BIN)/python -m tests.proof.results

picture: $(VENV)/.dev ## the README's picture of the page, in Chromium
	$(BIN)/python -m tests.browser.picture

gallery: $(VENV)/.dev ## what every effect of the emulated drive shows as: pictures and a page in build/gallery
	$(BIN)/python -m tests.gallery

prove: $(VENV)/.dev ## the proof in full, on the evaluation population: page and JSON in build/proof: an hour or so
	$(BIN)/python -m tests.proof

prove-quick: $(VENV)/.dev ## a part of it, on a development population: two minutes or so
	$(BIN)/python -m tests.proof --quick

score-diagnosis: $(VENV)/.dev ## the diagnosis on 500 concealed recordings of development seeds, beside an oracle: an hour or more
	$(BIN)/python -m tests.score

score: $(VENV)/.dev ## the diagnosis on 1,734 recordings that were looked at, beside what a kept library said: two hours
	$(BIN)/python -m tests.score.pooled $(PART:%=--part %)

tuned-numbers: $(VENV)/.dev ## how many numbers of the diagnosis somebody chose
	$(BIN)/python -m tests.bars.tuned_numbers

bench-diagnose: $(VENV)/.dev ## how long diagnoses of 6 s and of 60 s take on one core, and their memory
	$(BIN)/python -m tests.bars.bench_diagnose

$(VENV)/.run: pyproject.toml .ci/constraints.txt
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and "pmsm-bench needs Python 3.11 or later, got " + sys.version.split()[0])'
	@echo "installing into $(VENV): about half a minute"
	@$(PYTHON) -m venv $(VENV)
	@$(PIP) --editable .
	@touch $@

$(VENV)/.dev: $(VENV)/.run
	@echo "installing the tools of the checks"
	@$(PIP) --editable ".[dev,peers]"
	@touch $@

bench-estimator: $(VENV)/.dev ## the estimator's speed beside its peers and a C loop (needs gcc)
	$(BIN)/python -m tests.bars.bench_estimator

bench-export-c: $(VENV)/.dev ## the C module beside Python and the published window, its instructions: some minutes (gcc; clang, valgrind, qemu-user, gcc-arm-none-eabi)
	$(BIN)/python -m tests.bars.bench_export_c

bench-links: $(VENV)/.dev ## the links over loopback beside what their buses would allow: about nine minutes
	$(BIN)/python -m tests.bars.bench_links

bench-kills: $(VENV)/.dev ## 100 kills of the service while it holds a current, over four links
	$(BIN)/python -m tests.bars.bench_kills

bench-recordings: $(VENV)/.dev ## 100 kills of the service while it records streams and captures, over four links
	$(BIN)/python -m tests.bars.bench_recordings

bench-stale: $(VENV)/.dev ## how long estimates are ok after their drive is off, in fault, reset, unplugged, late: four links
	$(BIN)/python -m tests.bars.bench_stale

bench-faults: $(VENV)/.dev ## rows and captures over links under faults: about ten minutes
	$(BIN)/python -m tests.bars.bench_faults

bench-http: $(VENV)/.dev ## the HTTP interface under too much: what is answered, and how soon Stop is
	$(BIN)/python -m tests.bars.bench_http

bench-commission: $(VENV)/.dev ## 20 drives with a concealed effect, commissioned: parameters, loops before and after; 17 minutes
	$(BIN)/python -m tests.bars.bench_commission

bench-first-start: $(VENV)/.dev ## 50 motors that nobody knows: pole pairs, phase order, direction, angle offset; 25 minutes
	$(BIN)/python -m tests.bars.bench_first_start

bench-flash: $(VENV)/.dev ## 1,000 flashes under faults over four links: what the drive's memory holds afterwards; how long one takes
	$(BIN)/python -m tests.bars.bench_flash

bench-history: $(VENV)/.dev ## a day and a year of estimates on the page, in Chromium
	$(BIN)/python -m tests.bars.bench_history

bench-idle: $(VENV)/.dev ## processor time of a service and of a drive that nobody looks at, over four links: three minutes
	$(BIN)/python -m tests.bars.bench_idle

bench-load: $(VENV)/.dev ## four drives recorded, 20 event streams, 50 requests/s: rows, answers, memory, processor: ten minutes
	$(BIN)/python -m tests.bars.bench_load

bench-mechanics: $(VENV)/.dev ## inertia, friction and load torque of 600 drawn drives, and when none is told: eight minutes
	$(BIN)/python -m tests.bars.estimator.bench_mechanics

bench-plant: $(VENV)/.dev ## the emulated plant's speed, effect by effect and beside its peers
	$(BIN)/python -m tests.bars.bench_plant

bench-watch: $(VENV)/.dev ## what the watch over a stream costs, how quiet it is, how soon and how small it tells
	$(BIN)/python -m tests.bars.bench_watch

auto-window: $(VENV)/.dev ## windows chosen by the data beside fixed ones, 40 seeds: about ten minutes
	$(BIN)/python -m tests.bars.auto_window

clean: ## remove what make made
	rm -rf $(VENV) build .pytest_cache .ruff_cache .hypothesis .import_linter_cache
