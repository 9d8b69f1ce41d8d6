# The commands of every day. `make help` lists them; `make demo` and `make test` need nothing but Python 3.11+ and make.
# CONTRIBUTING.md lists the longer ones, `python -m tests.harness.NAME`.
# Every command works on a fresh clone: whatever needs the environment depends on $(STAMP), which creates it once.
# Linux and macOS only: the recipes are POSIX shell, and an environment on Windows has no bin/ folder.

VENV := .venv
BIN := $(VENV)/bin
# Touched after a complete installation. It is older than the lock or pyproject.toml when one of them has changed since;
# make then builds the environment anew.
STAMP := $(VENV)/.installed
# Processes that run the tests: more than processors, because many tests wait for programs that they start.
WORKERS = $(shell $(BIN)/python -c 'import os; print(3 * (os.cpu_count() or 1) // 2 or 1)')
# The interpreters that are tried, the newest first; `make setup PYTHON=python3.11` tries only that one.
PYTHONS := $(or $(PYTHON),python3.13 python3.12 python3.11 python3 python)
export PIP_DISABLE_PIP_VERSION_CHECK := 1

.DEFAULT_GOAL := help
.PHONY: help setup demo check format test bench verify pages docs viewer lock dist clean

# `## text` after a target is its line in this list, `##@ text` a heading.
help: ## list the commands
	@awk 'BEGIN { FS = ":.*## " } \
	  /^##@ / { printf "\n%s\n", substr($$0, 5) } \
	  /^[a-z-]+:.*## / { printf "  make %-14s %s\n", $$1, $$2 }' $(MAKEFILE_LIST)

##@ Every day

setup: $(STAMP) ## create .venv and install every dependency of requirements.lock, checked by hash (1 to 2 minutes)

# Python 3.14 is refused because the pinned MuJoCo has no wheels for it. --no-deps: the lock is complete, and for a
# dependency with extras, such as google-auth[requests], pip would look for the newest release instead of the locked one.
$(STAMP): requirements.lock pyproject.toml physment_mcp/version.py integrations/harbor/pyproject.toml
	@python=$$(for name in $(PYTHONS); do \
	  $$name -c 'import sys; sys.exit(not (3, 11) <= sys.version_info < (3, 14))' 2>/dev/null && echo $$name && break; \
	done); \
	if [ -z "$$python" ]; then echo "physment-mcp needs Python 3.11, 3.12 or 3.13; none of $(PYTHONS) is one." >&2; exit 1; fi; \
	echo "Creating $(VENV) with $$($$python --version)"; rm -rf $(VENV); $$python -m venv $(VENV)
	@echo "Installing the locked dependencies (a minute or two)"
	@$(BIN)/python -m pip install --quiet --require-hashes --no-deps -r requirements.lock
	@$(BIN)/python -m pip install --quiet --no-deps --no-build-isolation -e . -e integrations/harbor
	@touch $(STAMP)

demo: $(STAMP) ## let the reference agent solve every scene over stdio: shows that the laboratory works here
	@$(BIN)/physment-eval --server stdio

format: $(STAMP) ## lay out the code with ruff, and let ruff repair what it can repair safely
	@$(BIN)/ruff format .
	@$(BIN)/ruff check --fix .

check: $(STAMP) ## check layout (ruff format), rules (ruff check) and types (pyright, strict); changes nothing
	@$(BIN)/ruff format --check .
	@$(BIN)/ruff check .
	@$(BIN)/pyright --pythonpath $(BIN)/python

# The packs and logs of the published prototype are hidden, so that the tests and their coverage are the same for everybody.
test: $(STAMP) ## run the test suite without its `extended` cases, and require full coverage of the core modules, which pyproject.toml names
	@PHYSMENT_ORIGINAL=/nonexistent OPENBLAS_NUM_THREADS=1 $(BIN)/python -m pytest -n $(WORKERS) --dist worksteal --cov --cov-report=term

bench: $(STAMP) ## measure speed as ratios of two things timed in one run, into bench.json; nothing fails by being slow
	@$(BIN)/python -m tests.harness.bench.bench $(BENCH)

clean: ## remove the environments, built files and caches
	@rm -rf $(VENV) .docs .integrations .lowest .engines dist build .pytest_cache .ruff_cache .hypothesis .coverage

##@ Scenes

verify: $(STAMP) ## prove every new or changed scene sound on 20 seeds and write scenes/certificates.json (decision 11)
	@$(BIN)/physment-eval verify

pages: $(STAMP) ## write the pages about the scenes, with pictures, into docs/ (libosmesa6 draws the pictures)
	@$(BIN)/physment-eval scenes pages --out docs

##@ Documentation

# An environment of its own, which needs none of the packages of the laboratory.
DOCS := .docs/.installed
$(DOCS): requirements-docs.lock
	@python=$$(for found in $(PYTHONS); do \
	  $$found -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null && echo $$found && break; done); \
	if [ -z "$$python" ]; then echo "the website needs Python 3.11 or newer; none of $(PYTHONS) is one." >&2; exit 1; fi; \
	rm -rf .docs; $$python -m venv .docs
	@.docs/bin/python -m pip install --quiet --require-hashes --no-deps -r requirements-docs.lock
	@touch $@

docs: $(DOCS) ## build the website into build/site (Sphinx, 120 MB, into .docs); a warning or a broken link is an error
	@.docs/bin/python -m website

##@ Viewer (needs node 20 or newer, with npm)

# Scripts of packages are not run: none is needed. The files that it writes are committed.
viewer: ## install node's packages as locked, check types, and build the viewer into the files that the packages hold
	@cd viewer && npm ci --ignore-scripts --no-audit --no-fund && npm run --silent check && npm run --silent build

##@ Dependencies (needs uv: pip install uv)

# The options keep the addresses of registries out of the lock. uv keeps each present version that still fits, so the
# difference shows only what had to change.
lock: ## resolve the dependencies of pyproject.toml into requirements.lock and requirements-docs.lock
	@uv pip compile --universal --generate-hashes --no-header --no-annotate --no-emit-index-url --no-emit-find-links \
	  --python-version 3.11 --group dev pyproject.toml --quiet -o requirements.lock
	@{ echo '# Every dependency, runtime and development, with hashes. Regenerate with: make lock'; \
	  cat requirements.lock; } > requirements.lock.new
	@mv requirements.lock.new requirements.lock
	@uv pip compile --universal --generate-hashes --no-header --no-annotate --no-emit-index-url --no-emit-find-links \
	  --python-version 3.11 --group docs --quiet -o requirements-docs.lock
	@{ echo '# Every dependency of the website, with hashes. Regenerate with: make lock'; \
	  cat requirements-docs.lock; } > requirements.lock.new
	@mv requirements.lock.new requirements-docs.lock

##@ Release (CONTRIBUTING.md says how)

dist: $(STAMP) ## build sdist and wheel into dist/
	@$(BIN)/python -m build --no-isolation --outdir dist .
