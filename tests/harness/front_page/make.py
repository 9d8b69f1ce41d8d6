"""Writes pictures into docs/pictures (the film of an episode, a report, a film in it, the app), in light and in dark.

python -m tests.harness.front_page.make [--run DIR]    with the report of a run; without it, the run is played first
python -m tests.harness.front_page.make --only film    one of them

It needs Chromium and libosmesa6. `pytest tests/harness/front_page --update-goldens` writes the text around them.
"""

import argparse
import base64
import io
import json
import os
import signal
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

from PIL import Image
from rich.console import Console

from tests.builders.chromium import SOFTWARE_WEBGL, Page, chromium, installed
from tests.builders.paths import DOCS
from tests.harness.front_page.episode import PACKS, Played, caption, played

PICTURES = DOCS / "pictures"
SCHEMES = ("light", "dark")
DESCRIPTION = 0x010E
"""The EXIF tag ImageDescription, which contains the description of a picture."""
SCALE = 2
"""Device pixel ratio of the pictures, for high-resolution screens."""
REPORT_WIDTH = 1000
STUDY = (
    *("--agent", "reference", "--agent", "random", "--agent", "blind"),
    *("--budgets", "5,10,15,20", "--seeds", "1", "--server", "host", "--concurrency", "4"),
)
"""The run whose report is shown: 1,260 episodes."""


def main() -> None:
    """Write the pictures."""
    # MuJoCo selects its renderer at import; OSMesa needs neither a screen nor a graphics card.
    os.environ.setdefault("MUJOCO_GL", "osmesa")
    parser = argparse.ArgumentParser(description="Write the pictures of the README.")
    parser.add_argument("--run", type=Path, metavar="DIR", help="a run folder with a report; else it is played first")
    parser.add_argument("--only", choices=("episode", "report", "film", "preview"), help="write one of the pictures")
    args = parser.parse_args()
    program = installed()
    if program is None:
        sys.exit("Chromium is not installed, so there are no pictures: apt-get install chromium")
    with tempfile.TemporaryDirectory() as made, chromium(program, Path(made, "profile"), *SOFTWARE_WEBGL) as page:
        folder = Path(made)
        PICTURES.mkdir(exist_ok=True)
        draw = {
            "episode": lambda: _episode(page, played(folder / "episode"), folder / "episode.html"),
            "report": lambda: _report(page, (args.run or _played_study(folder / "study")) / "report.html"),
            "film": lambda: _film(page, folder / "film"),
            "preview": lambda: _preview(page),
        }
        for name in [args.only] if args.only else draw:
            draw[name]()


def _played_study(folder: Path) -> Path:
    subprocess.run([sys.executable, "-m", "evaluator", "run", *STUDY, "--out", str(folder)], check=True)
    return folder


def _episode(page: Page, played: Played, file: Path) -> None:
    """Write the film of the episode, and its last frame for readers who prefer reduced motion."""
    from tests.harness.front_page.film_picture import HEIGHT, PAGE, WIDTH, drawn
    from tests.harness.front_page.film_picture import SCALE as FILM_SCALE

    file.write_text(PAGE, encoding="utf-8")
    frames = list(drawn(played))
    durations = [frame.duration_ms for frame, _ in frames]
    page.send("Emulation.setDefaultBackgroundColorOverride", color={"r": 0, "g": 0, "b": 0, "a": 0})
    for scheme in SCHEMES:
        page.look(WIDTH, scheme, height=HEIGHT, scale=FILM_SCALE)
        page.open(file)
        shots: list[Image.Image] = []
        for _, body in frames:
            page.run(f"document.body.innerHTML = {json.dumps(body)}, document.querySelector('img').decode()")
            found = page.send("Page.captureScreenshot")
            shots.append(Image.open(io.BytesIO(base64.b64decode(found["data"]))).convert("RGBA"))
        _write(shots[-1:], "episode-still", scheme, caption(played))
        _write(shots, "episode", scheme, caption(played), durations)
    page.send("Emulation.setDefaultBackgroundColorOverride")


def _report(page: Page, file: Path) -> None:
    """Take the part of the report from its head to its first row of charts."""
    end = "document.querySelector('.charts figure').getBoundingClientRect().bottom + 6"
    _shoot(page, file, "report", REPORT_WIDTH, end, "The upper part of a report.")


def _film(page: Page, folder: Path) -> None:
    """Show the film of the README's episode in its report, in the middle of the first step."""
    played(folder)
    report = [sys.executable, "-m", "evaluator", "report", str(folder), "--scenes-dir", str(PACKS)]
    subprocess.run(report, check=True)
    scrub = "document.querySelector('.film-controls input')"
    for scheme in SCHEMES:
        page.look(REPORT_WIDTH, scheme, scale=SCALE)
        page.open(folder / "report.html", "#episode-1")
        page.run("document.querySelector('#episode-1 .film > button').click()")
        page.wait("document.querySelector('.film-box canvas') !== null")
        page.run(f"{scrub}.value = 0.5 * {scrub}.max")
        page.run(f"{scrub}.dispatchEvent(new Event('input'))")
        page.run("document.activeElement.blur()")
        page.run("document.querySelector('.film-panel').scrollIntoView({ block: 'center' })")
        page.run("new Promise((drawn) => setTimeout(drawn, 1500))")
        box = page.run("document.querySelector('.film-panel').getBoundingClientRect().toJSON()")
        clip = {name: box[name] for name in ("x", "width", "height")} | {
            "y": box["y"] + page.run("scrollY"),
            "scale": 1,
        }
        found = page.send("Page.captureScreenshot", clip=clip)
        _save(found["data"], "film", scheme, "A film of an episode in its report, with the calls beside it.")


def _preview(page: Page) -> None:
    """Show the app of the chat in `physment-mcp preview`, after a step in which three carts move."""
    command = [sys.executable, "-m", "physment_mcp", "preview", "13", "--no-open"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        address = process.stdout.readline().split(" at ")[1].split()[0]
        for scheme in SCHEMES:
            page.look(REPORT_WIDTH, scheme, height=640, scale=SCALE)
            page.send("Emulation.setScrollbarsHidden", hidden=True)
            page.visit(address)
            page.wait("!document.getElementById('run').disabled")
            page.run("document.querySelector('[name=duration]').value = '1'; document.getElementById('run').click()")
            page.wait("document.getElementById('calls').textContent.includes('sim_time')")
            page.run("document.activeElement.blur()")
            # The app is in a frame with another origin, so a script cannot ask whether its motion has ended.
            page.run("new Promise((drawn) => setTimeout(drawn, 4000))")
            found = page.send("Page.captureScreenshot")
            _save(found["data"], "preview", scheme, "The app of the chat in a local page, after a step.")
        process.send_signal(signal.SIGINT)


def _shoot(page: Page, file: Path, name: str, width: int, end: str, description: str) -> None:
    """Write the upper part of a page as NAME-light.webp and NAME-dark.webp, losslessly.

    Args:
        page: The browser.
        file: The page.
        name: Name of the picture.
        width: Width of the window [px].
        end: JavaScript expression for the lower end of the part [px].
        description: Description that is stored in the picture.
    """
    for scheme in SCHEMES:
        page.look(width, scheme, scale=SCALE)
        page.send("Emulation.setScrollbarsHidden", hidden=True)
        page.open(file)
        clip = {"x": 0, "y": 0, "width": width, "height": page.run(end), "scale": 1}
        found = page.send("Page.captureScreenshot", captureBeyondViewport=True, clip=clip)
        _save(found["data"], name, scheme, description)


def _save(data: str, name: str, scheme: str, description: str) -> None:
    """Write a screenshot as NAME-SCHEME.webp."""
    _write([Image.open(io.BytesIO(base64.b64decode(data)))], name, scheme, description)


def as_ascii(description: str) -> str:
    """Return a description with the characters that EXIF allows."""
    return description.replace("−", "-")


def _write(
    shots: Sequence[Image.Image], name: str, scheme: str, description: str, durations: Sequence[int] = ()
) -> None:
    """Write one picture, or several as a film that plays for ever, as NAME-SCHEME.webp, losslessly."""
    exif = Image.Exif()
    exif[DESCRIPTION] = as_ascii(description)
    target = PICTURES / f"{name}-{scheme}.webp"
    if durations:
        film = {"save_all": True, "append_images": shots[1:], "duration": [*durations], "loop": 0}
        # With the effort of a single picture, a film would take many minutes.
        shots[0].save(target, "WEBP", lossless=True, quality=80, method=4, exif=exif, **film)
    else:
        shots[0].save(target, "WEBP", lossless=True, quality=100, method=6, exif=exif)
    shown = f"{shots[0].width} × {shots[0].height}, {len(shots)} frames, {target.stat().st_size / 1000:.0f} kB"
    Console().print(f"{target}: {shown}")


if __name__ == "__main__":
    main()
