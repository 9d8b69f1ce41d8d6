# The commands of every day. `make help` lists them; `make demo` and `make test` need nothing but Python 3.11+ and make.
# Every command works on a fresh clone: whatever needs the environment depends on $(STAMP), which creates it once.
# Linux and macOS only: the recipes are POSIX shell, and an environment on Windows has no bin/ folder.

VENV := .venv
BIN := $(VENV)/bin
# Touched after a complete installation. It is older than the lock or pyproject.toml when one of them has changed since;
# make then builds the environment anew.
STAMP := $(VENV)/.installed
# Modules whose lines and branches the tests must cover completely, because results depend on them.
CORE := physment_mcp/session.py,physment_mcp/tools/calls.py,physment_mcp/scene.py,physment_mcp/mechanics.py,evaluator/records/episode.py,evaluator/episode/loop.py,evaluator/answers/grading.py,evaluator/answers/strict.py,evaluator/answers/forgiven.py,evaluator/scores/metrics.py,evaluator/scores/grouping.py,evaluator/scores/comparison.py,evaluator/scores/dimensions.py,evaluator/scores/scored_episode.py,evaluator/statistics/*
# Processes that run the tests: more than processors, because many tests wait for programs that they start.
WORKERS = $(shell $(BIN)/python -c 'import os; print(3 * (os.cpu_count() or 1) // 2 or 1)')
# The interpreters that are tried, the newest first; `make setup PYTHON=python3.11` tries only that one.
PYTHONS := $(or $(PYTHON),python3.13 python3.12 python3.11 python3 python)
MCPB := npx --yes @anthropic-ai/mcpb@2.1.2
export PIP_DISABLE_PIP_VERSION_CHECK := 1

.DEFAULT_GOAL := help
.PHONY: help setup demo check format test fuzz leaks bench hostile soak faults verify baselines pages pages-check pictures ray-test \
  docs clients conformance inspect-test engines integrations harbor mcpb viewer lock \
  test-lowest dist clean

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

# The second command is quiet and only decides; if it fails, the third prints the lines that are missing. The packs and
# logs of the published prototype are hidden, so that the tests and their coverage are the same for everybody.
test: $(STAMP) ## run the whole test suite, and require full coverage of the core modules
	@PHYSMENT_ORIGINAL=/nonexistent OPENBLAS_NUM_THREADS=1 $(BIN)/python -m pytest -n $(WORKERS) --dist worksteal --cov --cov-report=term
	@$(BIN)/coverage report --include=$(CORE) --fail-under=100 >/dev/null || \
	  { echo "The core must be covered completely, branches too:" >&2; $(BIN)/coverage report --include=$(CORE) >&2; exit 1; }

fuzz: $(STAMP) ## make 200 000 random tool calls and check what must always hold (about 5 minutes; FUZZ=--seed=3 for options)
	@$(BIN)/python -m tests.harness.fuzz.run $(FUZZ)

leaks: $(STAMP) ## search for what gives keys away: at the start, and by fixed lists of calls (30 minutes; LEAKS=--minutes=9)
	@$(BIN)/python -m tests.harness.fuzz.leaks $(LEAKS)

bench: $(STAMP) ## measure speed as ratios of two things timed in one run, into bench.json; nothing fails by being slow
	@$(BIN)/python -m tests.harness.bench.bench $(BENCH)

hostile: $(STAMP) ## measure how much each kind of hostile client slows honest clients of one host (10 minutes)
	@$(BIN)/python -m tests.harness.load.hostile

soak: $(STAMP) ## load one host with honest and hostile clients for 30 minutes; fails if its memory or its files grow
	@$(BIN)/python -m tests.harness.load.soak

faults: $(STAMP) ## strike 200 runs of the evaluator with signals, full disks and damaged files, and resume them (1 to 2 hours)
	@$(BIN)/python -m tests.harness.load.faults

clean: ## remove the environments, built files and caches
	@rm -rf $(VENV) .docs .inspect .integrations .lowest .engines dist build .pytest_cache .ruff_cache .hypothesis .coverage

##@ Scenes

verify: $(STAMP) ## prove every new or changed scene sound on 20 seeds and write scenes/certificates.json (decision 11)
	@$(BIN)/physment-eval verify

baselines: $(STAMP) ## play the baselines that reports show again, all or SCENES=7,81 (decision 47)
	@rm -rf build/baselines
	@$(BIN)/physment-eval run --server host --seeds 0 --scenes $(or $(SCENES),7-111) --out build/baselines \
	  --agent blind --agent random --agent batch --agent attacker:sweep --agent attacker:glance \
	  --agent attacker:proportional --agent constant
	@$(BIN)/physment-eval keep-baselines build/baselines

pages: $(STAMP) ## write the pages about the scenes, with pictures, into docs/ (libosmesa6 draws the pictures)
	@$(BIN)/physment-eval scenes pages --out docs

# Only the text is compared: pictures may differ in a pixel between versions of the renderer.
pages-check: pages ## the same, and fail if the text of a page changed: somebody forgot to run it
	@git diff --exit-code -- 'docs/*.md'

pictures: $(STAMP) ## play an episode and a study, and draw the README's pictures (chromium, libosmesa6; 5 processor minutes)
	@$(BIN)/python -m tests.harness.front_page.make

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

##@ Other programs (each installs what it tests)

clients: $(STAMP) ## play scenes through ten third-party MCP clients (2.8 GB, into ~/.cache) and write their table
	@$(BIN)/python -m tests.harness.clients.run --out docs/reference/clients.md

conformance: $(STAMP) ## run the official MCP conformance suite (by npx) against a host; only listed scenarios may fail
	@$(BIN)/python -m tests.harness.conformance.run --out docs/explanation/conformance.md

# An environment of its own, so that the many packages of Inspect AI do not mix with the locked ones.
inspect-test: ## install Inspect AI and its plugin (330 MB, into .inspect); test that it plays, grades and reads our logs
	@test -d .inspect || python3 -m venv .inspect
	@.inspect/bin/python -m pip install --quiet -e . -e integrations/inspect openai==3.52.0 pytest hypothesis
	@.inspect/bin/python -m pytest tests/integrations/test_inspect_task.py tests/integrations/test_inspect_log.py

engines: $(STAMP) ## try all scenes on the newest MuJoCo 3 and 4 (800 MB each, into .engines; ENGINES="4.1.0 --certify" for options)
	@$(BIN)/python -m tests.harness.engines.run $(ENGINES)

# Each in an environment of its own, because the frameworks pin versions of mcp that exclude ours and each other's. An
# environment that cannot be made, as NeMo Gym's before Python 3.12, is left out, and its tests are skipped.
integrations: $(STAMP) ## install verifiers, OpenEnv and NeMo Gym (2.4 GB, into .integrations) and test their packages
	@for name in verifiers openenv nemo_gym; do \
	  test -x .integrations/$$name/bin/pytest || { \
	    python=$$(for found in $(PYTHONS); do $$found -c '' 2>/dev/null && echo $$found && break; done); \
	    rm -rf .integrations/$$name; \
	    echo "Installing $$name"; $$python -m venv .integrations/$$name && \
	    .integrations/$$name/bin/python -m pip install --quiet -e integrations/client -e integrations/$$name uv pytest || \
	    { rm -rf .integrations/$$name; echo "$$name cannot be installed here: its tests are skipped" >&2; }; }; \
	done
	@$(BIN)/python -m pytest tests/integrations

# Harbor needs Python 3.12 or newer. Building the images of the tasks needs a container engine; this does not.
harbor: $(STAMP) ## write the suite as tasks of Harbor into build/harbor, check them (350 MB, into .integrations; HARBOR="--seeds 1000")
	@test -x .integrations/harbor/bin/harbor || { \
	  python=$$(for found in $(PYTHONS); do $$found -c '' 2>/dev/null && echo $$found && break; done); \
	  rm -rf .integrations/harbor; echo "Installing Harbor"; $$python -m venv .integrations/harbor && \
	  .integrations/harbor/bin/python -m pip install --quiet 'harbor>=0.24,<0.25'; }
	@rm -rf build/harbor
	@$(BIN)/physment-eval harbor write build/harbor $(HARBOR)
	@$(BIN)/python -m pytest tests/integrations/test_harbor_tasks.py tests/integrations/test_harbor.py

ray-test: $(STAMP) ## install Ray (70 MB) and test `--executor ray` on a cluster of several nodes on this machine
	@$(BIN)/python -m pip install --quiet --no-build-isolation --editable '.[ray]'
	@$(BIN)/python -m pytest tests/evaluator/study/ray_cluster

mcpb: $(STAMP) ## build the bundle for Claude Desktop into dist/; npx, if installed, fetches the tool that checks it
	@$(BIN)/physment-mcp bundle dist/physment.mcpb
	@if command -v npx >/dev/null; then \
	  rm -rf build/mcpb && mkdir -p build && $(MCPB) unpack dist/physment.mcpb build/mcpb && $(MCPB) validate build/mcpb; \
	else echo "npx is not installed: the bundle was not checked by its own tool"; fi

##@ Viewer (needs node 20 or newer, with npm)

# Scripts of packages are not run: none is needed. The files that it writes are committed.
viewer: ## install node's packages as locked, check types, and build the viewer into the files that the packages hold
	@cd viewer && npm ci --ignore-scripts --no-audit --no-fund && npm run --silent check && npm run --silent build

##@ Dependencies (both need uv: pip install uv)

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

# Only wheels but for our own packages: an old sdist may need a compiler, or a build tool that is gone.
test-lowest: ## test with the oldest versions that pyproject.toml allows (into .lowest; TESTS=tests/scenes for a part)
	@uv venv --quiet --clear $(if $(PYTHON),--python $(PYTHON)) .lowest
	@uv pip install --quiet --python .lowest --resolution lowest-direct --only-binary :all: \
	  --no-binary physment-mcp --no-binary physment-harbor --group dev -e '.[models,report]' -e integrations/harbor
	@.lowest/bin/python -m pytest -n auto --dist worksteal $(TESTS)

##@ Release (CONTRIBUTING.md says how)

dist: $(STAMP) ## build sdist and wheel into dist/
	@$(BIN)/python -m build --no-isolation --outdir dist .
