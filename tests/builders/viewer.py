"""The sources of the viewer, for tests where node's packages are installed (`make viewer`)."""

import shutil
import subprocess
from pathlib import Path

import pytest

from tests.builders.paths import ROOT

VIEWER = ROOT / "viewer"

needs_node = pytest.mark.skipif(
    shutil.which("node") is None or not (VIEWER / "node_modules").is_dir(), reason="run make viewer"
)


def run(*command: str) -> str:
    """Run a program of the viewer and return its output."""
    done = subprocess.run(command, cwd=VIEWER, capture_output=True, text=True, check=False, timeout=300)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def bundled(source: str) -> str:
    """Bundle a source file with its imports into one script."""
    script = run(str(VIEWER / "node_modules" / ".bin" / "esbuild"), source, "--bundle", "--format=iife", "--minify")
    return script.replace("</script", "<\\/script")


def page_with(script: str, folder: Path) -> Path:
    """Write an HTML page that only runs a script; return its path."""
    file = folder / "page.html"
    file.write_text(f'<!doctype html><meta charset="utf-8"><body><script>{script}</script>', encoding="utf-8")
    return file
