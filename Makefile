# Every target sets up what it needs: .venv from requirements.lock, once, and again when the lock changes.
# PYTHON=/path/to/python3 chooses another interpreter than python3.11; DEMO="..." passes options to the demo.

VENV := .venv/bin/python
export PYTHON

# One BLAS thread: the matrices are small, and threads that fight for cores make a fit forty times slower.
export OMP_NUM_THREADS = 1
export OPENBLAS_NUM_THREADS = 1
export MKL_NUM_THREADS = 1
export NUMBA_NUM_THREADS = 1
export MPLBACKEND = Agg
# Bytecode is kept even where the environment forbids it: pytest rewrites 200 files otherwise, for 8 s in every worker.
export PYTHONDONTWRITEBYTECODE =

# One worker of pytest more than there are cores, four at most: tests of the page wait for the browser most of the time.
WORKERS := $(shell n=$$(getconf _NPROCESSORS_ONLN 2>/dev/null || echo 2); echo $$((n < 4 ? n + 1 : 4)))

.PHONY: help setup simulators demo test readme slow check format bench generated golden fuzz faults paper docs site lock wheel screenshots clean
.DEFAULT_GOAL := help

help: ## this list
	@awk -F ':.*## ' '/^[a-z]+:.*## / { printf "  make %-12s %s\n", $$1, $$2 }' $(MAKEFILE_LIST)

setup: ## the environment in .venv, pinned by requirements.lock
	@bash scripts/setup_env.sh

demo: setup ## fly a vehicle with a hidden effect, name it, learn the rest, show the error fall
	$(VENV) -m wrenchgap demo $(DEMO)

test: setup ## the everyday test suite; TEST=tests/viewer for a part of it
	@bash scripts/install_browser.sh
	@$(VENV) scripts/warm_kernels.py # compiled once, and not by every worker of pytest
	$(VENV) -m pytest -m "not slow and not long" --numprocesses $(WORKERS) --dist loadfile --no-loadscope-reorder $(TEST)

readme: setup ## the commands of the README and of the first analysis, run as written
	$(VENV) -m pytest -m slow tests/test_readme.py

slow: setup ## tests of minutes: README, notebook, documentation, every kind of hidden effect (CI runs them too)
	@$(VENV) scripts/warm_kernels.py
	$(VENV) -m pytest -m slow --numprocesses auto --maxprocesses 4 --dist loadfile --no-loadscope-reorder

check: setup ## format, lint, types, layers, licences
	$(VENV) -m ruff format --check .
	$(VENV) -m ruff check .
	$(VENV) -m mypy
	$(VENV) -c "from importlinter.cli import lint_imports_command; lint_imports_command()"
	$(VENV) scripts/licences.py
	$(VENV) -m scripts.generate --check

format: setup ## rewrite the sources in the house format
	$(VENV) -m ruff format .
	$(VENV) -m ruff check --fix .

SPEED := reading_speed compensation_speed replay_speed loop_speed cold_start explain_speed learn_speed memory
bench: setup ## the tables of docs/performance.md, their rows as JSON in build/bench; then the other benchmarks/*.py
	@mkdir -p build/bench; set -e; for name in $(SPEED); do \
	  echo "== $$name"; $(VENV) -m benchmarks.$$name --page --json build/bench/$$name.json; done
	@set -e; for name in $(filter-out __init__ pages $(SPEED),$(basename $(notdir $(wildcard benchmarks/*.py)))); do \
	  echo "== $$name"; $(VENV) -m benchmarks.$$name; done

generated: setup ## print compensate/generated anew, after a change of kernels or tables
	$(VENV) -m scripts.generate

golden: setup ## keep the golden results and texts of tests/golden anew, after a change that was meant
	$(VENV) -m scripts.golden_replays --refresh
	$(VENV) -m scripts.golden_texts --refresh

fuzz: setup ## coverage-guided fuzzing of readers, model files and stored GPs (MINUTES=5 of processor time; atheris, Linux alone)
	$(VENV) -m benchmarks.faults.fuzz --minutes $(or $(MINUTES),5)

faults: setup ## the 20,000 damaged files: docs/faults.json, docs/reliability.md
	$(VENV) -m benchmarks.faults --json docs/faults.json --page docs/reliability.md

paper: setup ## the paper's experiments: benchmarks/paper/results, docs/images/paper-*.png, pages (PAPER=figure8: one)
	$(VENV) -m benchmarks.paper$(if $(PAPER),.$(PAPER))

docs: setup ## renew docs/effects/README.md, check every link, run every Python example
	$(VENV) scripts/effects_index.py
	$(VENV) scripts/check_docs.py

site: setup ## the documentation as site/index.html, which opens from a folder; a dead link or a page in no navigation fails
	NO_MKDOCS_2_WARNING=1 $(VENV) -m mkdocs build

screenshots: setup ## renew the viewer's pictures in docs/images (needs Chromium)
	$(VENV) scripts/screenshots.py

simulators: setup ## RotorPy and drone-models, which tests of `write` and benchmarks fly; CI has them where its index does
	$(VENV) -m pip install --quiet --require-hashes --no-deps -r scripts/simulators.lock

lock: setup ## renew requirements.lock: newest versions that suit Python 3.11 and later
	$(VENV) -m uv pip compile --quiet --upgrade --universal --python-version 3.11 --extra dev --generate-hashes \
	  --custom-compile-command "make lock" --output-file requirements.lock pyproject.toml
	$(VENV) -m uv pip compile --quiet --upgrade --universal --python-version 3.11 --no-deps --generate-hashes \
	  --custom-compile-command "make lock" --output-file scripts/simulators.lock scripts/simulators.in

wheel: setup ## build the wheel and try it in a new environment outside the repository
	$(VENV) scripts/try_wheel.py

clean: ## remove what the other targets made
	rm -rf .venv dist build site demo-output .mypy_cache .ruff_cache .pytest_cache .hypothesis .import_linter_cache
