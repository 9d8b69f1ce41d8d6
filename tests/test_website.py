"""Tests of the website that need no Sphinx: its pages and links, and the checks of the built site."""

import ast
import re
import sys
from pathlib import Path

import pytest

from tests.builders.paths import DOCS, ROOT
from tests.test_docs import anchors, links
from website.checks import faults
from website.links import Places
from website.pages import names, write_pages


@pytest.mark.parametrize("folder", ["website"])
def test_a_folder_beside_the_packages_needs_nothing_but_the_standard_library(folder: str) -> None:
    """The modules of `website` run before any package is installed, so they import only the standard library."""
    imported = {
        name.partition(".")[0]
        for path in (ROOT / folder).glob("*.py")
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        for name in (
            [alias.name for alias in node.names]
            if isinstance(node, ast.Import)
            else [node.module or ""]
            if isinstance(node, ast.ImportFrom)
            else []
        )
    }
    assert imported - set(sys.stdlib_module_names) == {folder}


@pytest.fixture(scope="module")
def pages(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("pages")
    write_pages(ROOT, folder)
    return folder


def test_every_page_is_on_the_site_and_in_its_navigation_once(pages: Path) -> None:
    entries = [
        (page.parent / f"{name}.md").resolve()
        for page in (pages / "index.md", pages / "decisions" / "README.md", pages / "reference" / "scenes.md")
        for name in re.findall(r"^.+ <([^>]+)>$", page.read_text(encoding="utf-8"), re.MULTILINE)
    ]
    assert len(entries) == len(set(entries))
    assert {*entries, pages / "index.md"} == set(pages.rglob("*.md"))
    assert {path.relative_to(DOCS) for path in DOCS.rglob("*.md")} <= {path.relative_to(pages) for path in entries} | {
        Path("index.md")
    }


def test_the_links_of_the_pages_still_lead_to_a_file_and_a_place_in_it(pages: Path) -> None:
    broken = [
        f"{page.relative_to(pages)}: {target}#{anchor}"
        for page in pages.rglob("*.md")
        for target, anchor in links(page)
        if not target.exists() or (anchor and anchor not in anchors(target))
    ]
    assert broken == []


@pytest.fixture
def places(tmp_path: Path) -> Places:
    """A checkout of two pages, a picture and a module."""
    (tmp_path / "docs" / "how-to").mkdir(parents=True)
    for name in ("docs/picture.png", "module.py", "SECURITY.md"):
        (tmp_path / name).touch()
    (tmp_path / "docs" / "index.md").write_text('# Index\n\n## A part\n\n<a id="mark"></a>\n', encoding="utf-8")
    on_site = {
        "docs/index.md": "index.md",
        "docs/how-to/page.md": "how-to/page.md",
        "docs/picture.png": "picture.png",
        "SECURITY.md": "project/security.md",
    }
    return Places(tmp_path, {tmp_path / path: name for path, name in on_site.items()}, "https://code.example/lab")


@pytest.mark.parametrize(
    ("written", "led"),
    [
        ("[a](../index.md)", "[a](../index.md)"),
        ("[a](../index.md#a-part)", "[a](../index.md#a-part)"),
        ("[a](../index.md#mark)", '<a href="../index.html#mark">a</a>'),
        ("[`a`](../../SECURITY.md)", "[`a`](../project/security.md)"),
        ("[a](../../module.py)", "[a](https://code.example/lab/blob/main/module.py)"),
        ("[a](https://example.org)", "[a](https://example.org)"),
        ("`[a](../nowhere.md)`", "`[a](../nowhere.md)`"),
        ("```text\n[a](../nowhere.md)\n```", "```text\n[a](../nowhere.md)\n```"),
        ('<img src="../picture.png">', '<img src="../picture.png">'),
    ],
)
def test_a_link_leads_to_the_place_of_its_target(places: Places, written: str, led: str) -> None:
    page = places.root / "docs" / "how-to" / "page.md"
    page.write_text(written, encoding="utf-8")
    assert places.led(page) == led


@pytest.mark.parametrize("written", ["[a](nowhere.md)", '<img src="nowhere.png">', '<img src="../../module.py">'])
def test_a_link_to_nothing_and_a_picture_that_is_not_there_are_refused(places: Places, written: str) -> None:
    page = places.root / "docs" / "how-to" / "page.md"
    page.write_text(written, encoding="utf-8")
    with pytest.raises(LookupError, match=r"docs/how-to/page\.md: .+ is missing"):
        places.led(page)


def test_without_an_address_of_the_source_the_words_of_a_link_to_it_stay(places: Places) -> None:
    page = places.root / "docs" / "how-to" / "page.md"
    page.write_text("[`a`](../../module.py)", encoding="utf-8")
    assert Places(places.root, places.names, None).led(page) == "`a`"


def test_the_pages_have_names_of_their_own() -> None:
    given = list(names(ROOT).values())
    assert len(given) == len(set(given))


@pytest.mark.parametrize(
    ("html", "fault"),
    [
        ('<script src="https://cdn.example/x.js"></script>', "index.html loads https://cdn.example/x.js"),
        ('<link rel="stylesheet" href="//fonts.example/x.css">', "index.html loads //fonts.example/x.css"),
        ('<img src="lost.png">', "index.html shows lost.png, which is missing"),
        ('<a href="lost.html">a</a>', "index.html links lost.html, which is missing"),
        ('<a href="#lost">a</a>', "index.html links #lost, and there is no such place"),
        ('<a href="other.html#lost">a</a>', "index.html links other.html#lost, and there is no such place"),
    ],
)
def test_a_fault_of_a_built_page_is_found(tmp_path: Path, html: str, fault: str) -> None:
    (tmp_path / "other.html").write_text('<p id="place"></p>', encoding="utf-8")
    (tmp_path / "index.html").write_text(html, encoding="utf-8")
    assert faults(tmp_path) == [fault]


def test_a_font_from_elsewhere_is_found_and_a_sound_site_has_no_faults(tmp_path: Path) -> None:
    (tmp_path / "index.html").write_text(
        '<p id="top"></p><a href="#top">a</a><a href="https://example.org">b</a><img src="data:image/png;base64,AA==">'
        '<link rel="canonical" href="https://example.org/">',
        encoding="utf-8",
    )
    assert faults(tmp_path) == []
    (tmp_path / "site.css").write_text("@font-face { src: url(https://fonts.example/a.woff2) }", encoding="utf-8")
    assert faults(tmp_path) == ["site.css loads https://fonts.example/a.woff2"]
