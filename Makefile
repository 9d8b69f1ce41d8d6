# Set-up and the commands of every day. `make demo` and `make test` need nothing but Python 3.11+ and make.

VENV := .venv
BIN := $(VENV)/bin
STAMP := $(VENV)/.installed
CORE := physment_mcp/session.py,physment_mcp/tools/calls.py,physment_mcp/scene.py,physment_mcp/mechanics.py,evaluator/records.py,evaluator/episode/loop.py,evaluator/answers/grading.py,evaluator/answers/strict.py,evaluator/answers/forgiven.py,evaluator/scores/metrics.py,evaluator/scores/grouping.py,evaluator/scores/comparison.py,evaluator/scores/dimensions.py,evaluator/statistics/*
MCPB := npx --yes @anthropic-ai/mcpb@2.1.2
export PIP_DISABLE_PIP_VERSION_CHECK := 1

.DEFAULT_GOAL := help
.PHONY: help demo test ray-test clients conformance inspect-test verify check bench pages lock mcpb wheel clean setup

help: ## list the commands
	@grep -E '^[a-z-]+:.*## ' $(MAKEFILE_LIST) | sed -E 's/^([a-z-]+):.*## (.*)/make \1|\2/' | column -t -s '|'

setup: $(STAMP) ## create .venv and install everything, locked by hash

$(STAMP): requirements.lock pyproject.toml
	@python=$$(for name in python3.13 python3.12 python3.11 python3 python; do \
	  $$name -c 'import sys; sys.exit(not (3, 11) <= sys.version_info < (3, 14))' 2>/dev/null && echo $$name && break; \
	done); \
	if [ -z "$$python" ]; then echo "physment-mcp needs Python 3.11, 3.12 or 3.13, and finds none on this machine." >&2; exit 1; fi; \
	echo "Creating $(VENV) with $$($$python --version)"; rm -rf $(VENV); $$python -m venv $(VENV)
	@echo "Installing the locked dependencies (a minute or two)"
	@$(BIN)/python -m pip install --quiet --require-hashes -r requirements.lock
	@$(BIN)/python -m pip install --quiet --no-deps --no-build-isolation -e .
	@touch $(STAMP)

demo: $(STAMP) ## set up, then let the reference agent solve every scene over stdio
	@$(BIN)/physment-eval --server stdio

test: $(STAMP) ## set up, then run the whole test suite
	@$(BIN)/python -m pytest --cov --cov-report=term
	@$(BIN)/coverage report --include=$(CORE) --fail-under=100 >/dev/null || \
	  { echo "The core must be covered whole, branches too:" >&2; $(BIN)/coverage report --include=$(CORE) >&2; exit 1; }

ray-test: $(STAMP) ## install Ray (70 MB) and test `--executor ray` on a cluster of several nodes on this machine
	@$(BIN)/python -m pip install --quiet --no-build-isolation --editable '.[ray]'
	@$(BIN)/python -m pytest tests/evaluator/study/ray_cluster

clients: $(STAMP) ## install eight third-party MCP clients (1.6 GB, into ~/.cache) and play a scene through each of them
	@$(BIN)/python tests/clients/run.py --out docs/reference/clients.md

conformance: $(STAMP) ## run the official MCP conformance suite (by npx) against a host; only what is listed may fail
	@$(BIN)/python tests/conformance/run.py --out docs/explanation/conformance.md

inspect-test: ## install Inspect AI (330 MB, into .inspect) and test that it plays and grades as physment-eval does
	@test -d .inspect || python3 -m venv .inspect
	@.inspect/bin/python -m pip install --quiet -e '.[inspect]' openai==3.52.0 pytest hypothesis
	@.inspect/bin/python -m pytest tests/clients/test_inspect_task.py

verify: $(STAMP) ## prove all scenes sound, on 20 seeds each, and write their certificates (some minutes; see docs/decisions/0011)
	@$(BIN)/physment-eval verify

check: $(STAMP) ## format, lint, types
	@$(BIN)/ruff format --check .
	@$(BIN)/ruff check .
	@$(BIN)/pyright --pythonpath $(BIN)/python

bench: $(STAMP) ## speed, as ratios measured in one run
	@$(BIN)/python tests/bench/bench.py

pages: $(STAMP) ## write the pages about the scenes, with pictures, into docs/ (libosmesa6 draws them)
	@$(BIN)/physment-eval scenes pages --out docs

mcpb: $(STAMP) ## build the bundle for Claude Desktop into dist/; its own tool checks it where npx is installed
	@$(BIN)/physment-mcp bundle dist/physment.mcpb
	@if command -v npx >/dev/null; then \
	  rm -rf build/mcpb && mkdir -p build && $(MCPB) unpack dist/physment.mcpb build/mcpb && $(MCPB) validate build/mcpb; \
	else echo "npx is not installed: the bundle was not checked by its own tool"; fi

wheel: $(STAMP) ## build the wheel into dist/
	@$(BIN)/python -m build --wheel --no-isolation

lock: ## resolve the dependencies anew into requirements.lock (needs uv)
	@uv pip compile --universal --generate-hashes --no-header --no-annotate --no-emit-index-url --no-emit-find-links \
	  --python-version 3.11 --group dev pyproject.toml --quiet -o requirements.lock
	@sed -i.old '1i # Every dependency, runtime and development, with hashes. Regenerate with: make lock' requirements.lock
	@rm requirements.lock.old

clean: ## remove what the commands above made
	@rm -rf $(VENV) dist build .pytest_cache .ruff_cache .hypothesis .coverage
