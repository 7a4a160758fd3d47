# Everything a person does here, one target each; `make` alone lists them.
.DEFAULT_GOAL := help
.DELETE_ON_ERROR:
MAKEFLAGS += --no-print-directory

VENV := .venv
BIN := $(VENV)/bin
PIP := $(BIN)/python -m pip install -qq --disable-pip-version-check

# `make app ADDRESS=0.0.0.0` lets other machines in, HOST=app.lab.org by that name only; without PORT
# the first free one from 8501 on.
LISTEN = $(if $(ADDRESS),--address $(ADDRESS) $(if $(HOST),--host $(HOST))) $(if $(PORT),--port $(PORT))

# One test process a core; each keeps its linear algebra to one thread. A file's tests share one. In
# the order of names the browser's come first, so that short ones fill the end. Bytecode is kept even
# where the environment forbids it, as many processes load the package.
WORKERS ?= 2

.PHONY: help
help:  ## show this list
	@echo "accpinn: learn the parameters of adaptive cruise control from recordings"
	@echo
	@grep -hE '^[a-z]+:.*## ' $(MAKEFILE_LIST) | sed -E 's/:.*## /\t/' | \
	    awk -F '\t' '{ printf "  make %-12s %s\n", $$1, $$2 }'

.PHONY: app
app: $(VENV)/app.stamp  ## install what is missing, start the app and print its address
	@echo "Starting the app; stop it with Ctrl+C."
	@$(BIN)/accpinn app $(LISTEN)

.PHONY: test
test: $(VENV)/dev.stamp  ## run all tests (real recordings: set OPENACC_DIR; browser: needs Chromium)
	@OMP_NUM_THREADS=1 PYTHONDONTWRITEBYTECODE= $(BIN)/python -m pytest -q -n $(WORKERS) --dist loadfile --no-loadscope-reorder --durations=10 $(ARGS)

# The smallest finding of a kind is kept in fuzz_findings; the same call tries it first.
MINUTES ?= 2

.PHONY: fuzz
fuzz: $(VENV)/dev.stamp  ## hand over hostile files and command lines for MINUTES=2
	@OMP_NUM_THREADS=1 FUZZ_MINUTES=$(MINUTES) $(BIN)/python -m pytest -q tests/fuzz --hypothesis-show-statistics $(ARGS)

.PHONY: check
check: $(VENV)/dev.stamp  ## lint, formatting, types and the direction of imports
	@$(BIN)/ruff check .
	@$(BIN)/ruff format --check .
	@$(BIN)/mypy
	@$(BIN)/lint-imports

.PHONY: format
format: $(VENV)/dev.stamp  ## format the code and mend what the linter can
	@$(BIN)/ruff check --fix .
	@$(BIN)/ruff format .

.PHONY: docs
docs: $(VENV)/dev.stamp  ## make the documentation in docs/_build, with the reference of all public names
	@$(BIN)/python -m sphinx -b html -W --keep-going -q docs docs/_build
	@echo "docs/_build/index.html"

.PHONY: bench
bench: $(VENV)/dev.stamp  ## time everyday things beside the last release (real recordings: set OPENACC_DIR)
	@$(BIN)/python -m bench $(ARGS)

.PHONY: lock
lock: $(VENV)/dev.stamp  ## lock versions and hashes of all packages; ARGS=--upgrade for the newest
	@$(BIN)/python -m bench.lock $(ARGS)

.PHONY: audit
audit: $(VENV)/dev.stamp  ## ask for known weaknesses of the locked packages (needs the internet)
	@$(BIN)/python -m bench.audit

.PHONY: samples
samples: $(VENV)/app.stamp  ## write the recordings of sample_data again from their truth files
	@$(BIN)/python -m accpinn.recordings.synthetic sample_data

.PHONY: study
study: $(VENV)/app.stamp  ## compute the supplied study again; RECORDINGS="FOLDER .." of OpenACC
	@OMP_NUM_THREADS=1 $(BIN)/python -m accpinn.study.supplied $(RECORDINGS) sample_data/openacc_study

.PHONY: dataset
dataset: $(VENV)/app.stamp  ## parameters of all cars, ready to be published; RECORDINGS="FOLDER .." OUT=FOLDER
	@OMP_NUM_THREADS=1 $(BIN)/accpinn dataset $(RECORDINGS) --out $(OUT)

.PHONY: screenshots
screenshots: $(VENV)/dev.stamp  ## picture every page, in tests/browser/shots (needs Chromium)
	@$(BIN)/python -m tests.browser.screenshots $(ARGS)

.PHONY: clean
clean:  ## remove .venv and everything the tools left behind
	@rm -rf $(VENV) docs/_build .pytest_cache .mypy_cache .ruff_cache .import_linter_cache .hypothesis
	@find . -name __pycache__ -type d -prune -exec rm -rf {} +

# A stamp is younger than its list of packages exactly when they are installed: first the files with
# the hashes of the lock file, then what it leaves to a version, which is PyTorch. The package itself
# is installed as it lies here, so that a script anywhere imports it.
$(VENV)/app.stamp: requirements.txt requirements.lock pyproject.toml setup.py | $(BIN)/python
	@echo "Installing the app's packages into $(VENV) (the first time takes some minutes) ..."
	@$(PIP) --require-hashes -r requirements.lock
	@$(PIP) -r requirements.txt
	@$(PIP) --no-deps -e .
	@touch $@

$(VENV)/dev.stamp: requirements-dev.txt requirements-dev.lock $(VENV)/app.stamp
	@echo "Installing the packages for tests and checks into $(VENV) ..."
	@$(PIP) --require-hashes -r requirements-dev.lock
	@$(PIP) -r requirements-dev.txt
	@touch $@

# `python3` first, as it is what the machine's owner chose.
$(BIN)/python:
	@for python in $(PYTHON) python3 python3.13 python3.12 python3.11; do \
	    if $$python -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null; then \
	        echo "Making $(VENV) with $$($$python --version) ..."; \
	        $$python -m venv $(VENV) && exit 0; \
	        rm -rf $(VENV); \
	        echo "$(VENV): Python could not make it; install Python's venv module" \
	            "(on Debian and Ubuntu the package python3-venv)." >&2; \
	        exit 1; \
	    fi; \
	done; \
	echo "Python: 3.11 or newer is needed and was not found; install it, or name it with" \
	    "'make PYTHON=/path/to/python3.11 $(MAKECMDGOALS)'." >&2; \
	exit 1
