"""Tests of the project's own files: make targets, workflows, commit hooks, citation, decision records, guides."""

import hashlib
import importlib.util
import json
import os
import re
import shlex
import shutil
import subprocess
import sysconfig
import tomllib
from itertools import chain
from pathlib import Path
from typing import Any

import pytest
import yaml
from packaging.specifiers import SpecifierSet

from evaluator.study.selection import parse_scenes
from physment_mcp import __version__
from scenes import list_packs
from tests.builders.paths import DOCS, ROOT

WORKFLOWS: dict[str, dict[str, Any]] = {
    file.stem: yaml.safe_load(file.read_text(encoding="utf-8"))
    for file in (ROOT / ".github" / "workflows").glob("*.yml")
}
WORKFLOW = WORKFLOWS["ci"]
HOOKS: dict[str, Any] = yaml.safe_load((ROOT / ".pre-commit-config.yaml").read_text(encoding="utf-8"))
CITATION: dict[str, Any] = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
PYPROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
PROJECT: dict[str, Any] = PYPROJECT["project"]
MAKEFILE = (ROOT / "Makefile").read_text(encoding="utf-8")
CI = (ROOT / ".ci" / "run").read_text(encoding="utf-8")
TARGETS = set(re.findall(r"^([a-z-]+):", MAKEFILE, flags=re.MULTILINE))
GUIDES = ("CONTRIBUTING.md", "SECURITY.md")


def steps(job: dict[str, Any]) -> list[dict[str, Any]]:
    return job["steps"]


def commands(workflow: dict[str, Any]) -> list[str]:
    """Every shell command of the workflow."""
    return [
        part.strip()
        for job in workflow["jobs"].values()
        for step in steps(job)
        for part in step.get("run", "").split("&&")
    ]


def test_every_make_target_is_explained_and_is_no_file() -> None:
    explained = set(re.findall(r"^([a-z-]+):.*## \w+", MAKEFILE, flags=re.MULTILINE))
    phony = re.search(r"^\.PHONY: ((?:.*\\\n)*.*)$", MAKEFILE, flags=re.MULTILINE)
    assert phony is not None
    assert TARGETS == explained == set(phony[1].replace("\\", "").split())


def test_the_tests_and_their_coverage_need_no_published_packs() -> None:
    """Contributors do not have the published packs, so the other tests must cover the same code."""
    recipe = re.search(r"^test:.*\n((?:\t.*\n)+)", MAKEFILE, flags=re.MULTILINE)
    assert recipe is not None
    assert re.match(r"\t@PHYSMENT_ORIGINAL=/nonexistent .*-m pytest .*--cov", recipe[1])
    assert not Path("/nonexistent").exists()
    commands = [line for line in CI.splitlines() if line and not line.startswith("#")]
    assert commands[-3:] == ["make check", "make test", ".venv/bin/python -m pytest -m published -rs"]


def test_the_modules_that_must_be_covered_exist() -> None:
    core = PYPROJECT["tool"]["coverage"]["run"]["include"]
    assert [name for name in core if not list(ROOT.glob(name))] == []
    assert PYPROJECT["tool"]["coverage"]["report"]["fail_under"] == 100


def test_every_test_that_reads_the_published_packs_is_marked() -> None:
    """The mark `published` skips a test where the packs are missing, and excludes it from coverage where they exist."""
    reading = {
        file.relative_to(ROOT).as_posix(): file.read_text(encoding="utf-8")
        for file in (ROOT / "tests").rglob("test_*.py")
        if re.search(r"import .*\bORIGINAL\b", file.read_text(encoding="utf-8"))
    }
    assert set(reading) == {"tests/evaluator/scores/failures/test_labels.py", "tests/scenes/test_packs_format.py"}
    assert [name for name, text in reading.items() if "@pytest.mark.published\n" not in text] == []


def test_the_workflow_tests_every_supported_python_with_locked_and_lowest_dependencies() -> None:
    matrix = WORKFLOW["jobs"]["test"]["strategy"]["matrix"]
    named = [classifier.rsplit(" ", 1)[1] for classifier in PROJECT["classifiers"] if ":: Python :: 3." in classifier]
    supported = SpecifierSet(PROJECT["requires-python"])
    assert matrix["python"] == named == [f"3.{minor}" for minor in range(30) if f"3.{minor}" in supported]
    assert matrix["dependencies"] == ["locked", "lowest"]


def test_the_jobs_of_the_workflow_call_make_targets_that_exist() -> None:
    called = {command.split()[1] for command in commands(WORKFLOW) if command.startswith("make ")}
    assert called == {"check", "test", "setup", "pages", "docs", "dist"}
    assert called <= TARGETS


def test_the_nightly_jobs_run_harnesses_that_exist_and_prove_every_scene() -> None:
    harness, certificates = WORKFLOWS["nightly"]["jobs"].values()
    named = [words.split()[0] for words in harness["strategy"]["matrix"]["harness"]]
    assert ".venv/bin/python -m tests.harness.${{ matrix.harness }}" in commands(WORKFLOWS["nightly"])
    assert [name for name in named if importlib.util.find_spec(f"tests.harness.{name}") is None] == []
    assert {"fuzz.run", "fuzz.leaks", "load.hostile", "load.soak", "load.faults"} <= set(named)
    parts = [selected_scenes(part) for part in certificates["strategy"]["matrix"]["scenes"]]
    assert sorted(chain(*parts)) == [files.scene_id for files in list_packs()]


def selected_scenes(part: str) -> list[int]:
    return [files.scene_id for files in parse_scenes(part, None)]


def test_the_harnesses_that_pages_name_exist() -> None:
    pages = (ROOT / "CONTRIBUTING.md", *DOCS.rglob("*.md"))
    text = "".join(page.read_text(encoding="utf-8") for page in pages)
    named = set(re.findall(r"python -m (tests\.harness(?:\.\w+)+)", text))
    assert len(named) > 5
    assert [name for name in named if importlib.util.find_spec(name) is None] == []


def test_a_release_is_checked_and_each_job_may_write_only_what_it_makes() -> None:
    jobs = WORKFLOWS["release"]["jobs"]
    (called,) = [command.split()[1:-1] for command in commands(WORKFLOWS["release"]) if command.startswith("make ")]
    assert called == ["check", "test", "dist"]
    assert set(called) <= TARGETS
    assert WORKFLOWS["release"]["permissions"] == {"contents": "read"}
    assert jobs["page"]["permissions"] == {"contents": "write"}
    assert jobs["index"]["permissions"] == {"contents": "read", "id-token": "write"}


def released(name: str, folder: Path, tag: str) -> int:
    """Run a step of the release in a folder; returns its exit code."""
    (step,) = (step for step in steps(WORKFLOWS["release"]["jobs"]["page"]) if step.get("name") == name)
    place = {"GITHUB_SERVER_URL": "https://github.com", "GITHUB_REPOSITORY": "some-lab/physment"}
    env = {**os.environ, **place, "GITHUB_REPOSITORY_OWNER": "some-lab", "GITHUB_REF_NAME": tag}
    return subprocess.run(["bash", "-e", "-c", step["run"]], cwd=folder, env=env, check=False).returncode


def test_a_release_needs_the_tag_of_its_version_and_a_section_of_the_changelog(tmp_path: Path) -> None:
    shutil.copytree(ROOT / "physment_mcp", tmp_path / "physment_mcp", ignore=lambda *_: {"world", "serving", "tools"})
    (tmp_path / "dist").mkdir()
    sections = ("# Changelog", "## Unreleased", "- Later.", "## 0.2.0 (2030-01-02)", "- New.", "## 0.1.0 (2029-01-01)")
    (tmp_path / "CHANGELOG.md").write_text("\n\n".join([*sections, "- Old.\n"]), encoding="utf-8")
    assert released("Refuse a tag that is not the version", tmp_path, f"v{__version__}") == 0
    assert released("Refuse a tag that is not the version", tmp_path, "v9.0.0") != 0
    assert released("Take the notes from the changelog", tmp_path, "v0.2.0") == 0
    assert (tmp_path / "dist" / "notes.md").read_text(encoding="utf-8").strip() == "- New."
    assert released("Take the notes from the changelog", tmp_path, "v0.3.0") != 0


def test_the_entry_keeps_the_rules_of_the_registry(tmp_path: Path) -> None:
    """Checks the rules of the registry's schema that apply, and those that the registry checks itself."""
    (tmp_path / "dist").mkdir()
    (tmp_path / "dist" / "physment.mcpb").write_bytes(b"a bundle")
    (tmp_path / ".github").mkdir()
    shutil.copy(ROOT / ".github" / "server.json", tmp_path / ".github")
    assert released("Write the entry in the MCP registry", tmp_path, "v0.2.0") == 0
    entry = json.loads((tmp_path / "dist" / "server.json").read_text(encoding="utf-8"))
    assert entry["name"] == "io.github.some-lab/physment-mcp"
    assert re.fullmatch(r"[a-zA-Z0-9.-]+/[a-zA-Z0-9._-]+", entry["name"])
    assert 1 <= len(entry["description"]) <= 100
    assert 1 <= len(entry["title"]) <= 100
    assert entry["repository"] == {"url": "https://github.com/some-lab/physment", "source": "github"}
    (package,) = entry["packages"]
    assert package["version"] == entry["version"] == "0.2.0"
    assert package["transport"] == {"type": "stdio"}
    assert package["identifier"] == "https://github.com/some-lab/physment/releases/download/v0.2.0/physment.mcpb"
    assert package["fileSha256"] == hashlib.sha256(b"a bundle").hexdigest()


def test_one_job_of_the_workflow_waits_for_all_others() -> None:
    jobs = WORKFLOW["jobs"]
    gate = jobs["required-checks-pass"]
    assert set(gate["needs"]) == set(jobs) - {"required-checks-pass"}
    assert gate["if"] == "always()"
    for result in ("failure", "cancelled", "skipped"):
        assert f"contains(needs.*.result, '{result}')" in steps(gate)[0]["if"]


@pytest.mark.parametrize("name", WORKFLOWS)
def test_the_actions_of_a_workflow_are_pinned_to_a_commit_and_say_its_version(name: str) -> None:
    text = (ROOT / ".github" / "workflows" / f"{name}.yml").read_text(encoding="utf-8")
    used = re.findall(r"uses: (.+)", text)
    assert used
    assert [one for one in used if not re.fullmatch(r"actions/[a-z-]+@[0-9a-f]{40} # v\d+\.\d+\.\d+", one)] == []


def test_the_commit_hooks_run_the_tools_of_this_project_and_download_nothing() -> None:
    (repository,) = HOOKS["repos"]
    assert repository["repo"] == "local"
    for hook in repository["hooks"]:
        assert hook["language"] == "system"
        program, argument, *_ = shlex.split(hook["entry"])
        if program == "make":
            assert argument in TARGETS
        else:
            tool = Path(program)
            assert tool.parent == Path(".venv/bin")
            assert (Path(sysconfig.get_path("scripts")) / tool.name).is_file()


def test_the_version_is_in_one_place_and_the_citation_names_no_address_of_its_own() -> None:
    assert CITATION["cff-version"] == "1.2.0"
    assert PROJECT["dynamic"] == ["version"]
    place = ROOT / PYPROJECT["tool"]["hatch"]["version"]["path"]
    assert f'__version__ = "{__version__}"\n' in place.read_text(encoding="utf-8")
    changelog = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    assert re.findall(r"^## (\d+\.\d+\.\d+) \(\d{4}-\d\d-\d\d\)$", changelog, re.MULTILINE)[0] == __version__
    assert CITATION["license"] == PROJECT["license"]
    assert CITATION["authors"] == PROJECT["authors"] == [{"name": "PhysMent MCP contributors"}]
    assert {"message", "title", "type"} <= CITATION.keys()
    assert CITATION.get("repository-code") == PROJECT.get("urls", {}).get("Source")
    assert CITATION.keys().isdisjoint({"url", "doi", "repository", "contact", "version"})


def test_the_sections_of_the_changelog_are_those_of_keep_a_changelog() -> None:
    changelog = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    unreleased, *versions = re.findall(r"^## (.+)$", changelog, re.MULTILINE)
    assert unreleased == "Unreleased"
    assert [one for one in versions if not re.fullmatch(r"\d+\.\d+\.\d+ \(\d{4}-\d\d-\d\d\)", one)] == []
    kinds = {"Added", "Changed", "Deprecated", "Removed", "Fixed", "Security"}
    assert set(re.findall(r"^### (.+)$", changelog, re.MULTILINE)) <= kinds


def test_the_packages_of_integrations_have_the_version_of_the_project() -> None:
    packages = sorted((ROOT / "integrations").glob("*/pyproject.toml"))
    found = {
        file.parent.name: tomllib.loads(file.read_text(encoding="utf-8"))["project"]["version"] for file in packages
    }
    assert len(found) == 7
    assert set(found.values()) == {__version__}
    manifest = yaml.safe_load((ROOT / "integrations" / "openenv" / "openenv.yaml").read_text(encoding="utf-8"))
    assert manifest["version"] == __version__


def test_the_index_of_the_decisions_has_a_line_for_every_record() -> None:
    folder = DOCS / "decisions"
    records = sorted(file.name for file in folder.glob("[0-9]*.md"))
    rows = re.findall(
        r"^\| \[(\d+)\]\((.+?)\) \| .+ \|$", (folder / "README.md").read_text(encoding="utf-8"), re.MULTILINE
    )
    assert [name for _, name in rows] == records
    for number, name in rows:
        assert int(name[:4]) == int(number)
        assert (folder / name).read_text(encoding="utf-8").startswith(f"# {number}. ")


def test_no_file_has_the_marks_of_an_unresolved_merge() -> None:
    marked = [
        file
        for folder in ("docs", "integrations", "website")
        for file in (ROOT / folder).rglob("*")
        if file.suffix in {".md", ".py", ".toml", ".yaml"}
        and re.search(r"^(<{7}|>{7}) ", file.read_text(encoding="utf-8"), re.MULTILINE)
    ]
    assert marked == []


@pytest.mark.parametrize("guide", GUIDES)
def test_every_path_link_and_make_target_that_a_guide_names_exists(guide: str) -> None:
    text = (ROOT / guide).read_text(encoding="utf-8")
    paths = [path for path in re.findall(r"`([\w./-]+)`", text) if "/" in path and path != "dist/"]
    links = [link for link in re.findall(r"\]\(([^)#]+)\)", text) if ":" not in link]
    assert [path for path in [*paths, *links] if not (ROOT / path).exists()] == []
    assert set(re.findall(r"(?:`|^)make ([a-z-]+)", text, flags=re.MULTILINE)) <= TARGETS
