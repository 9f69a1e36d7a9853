"""The documents name what exists: every internal link, heading, picture, file and page of the site."""

import os
import re
import subprocess
import sys
from functools import cache
from pathlib import Path

import pytest
import yaml

ROOT = Path(__file__).parents[1]
DOCUMENTS = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").rglob("*.md"))]
LINK = re.compile(r"!?\[[^\]]*\]\(([^)\s]+)\)")
FILE = re.compile(r"`((?:[\w.-]+/)+[\w.-]*\.(?:py|md|yaml|yml|ts|png|css|toml)|[\w-]+\.py)`")
"""A path in code, with a known ending; one without a folder only for Python."""
PACKAGES = ("", "snakeslam", "snakeslam/estimation", "snakeslam/runtime", "snakeslam/backends", "web/src")
"""Where a path may begin: a page on the estimator names ``filter/state.py``."""
OF_RECORDINGS = {"cam0/sensor.yaml", "imu0/sensor.yaml"}
NEW = "NAME."
"""Stands for a file that the reader is to make."""
WIDTH = 120


@cache
def anchors(document: Path) -> set[str]:
    """Return the anchors of a document's headings, as GitHub and MkDocs make them."""
    text = re.sub(r"^```.*?^```", "", document.read_text(encoding="utf-8"), flags=re.MULTILINE | re.DOTALL)
    headings = re.findall(r"^#+ (.*)$", text, flags=re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).strip().replace(" ", "-") for heading in headings}


@cache
def names() -> frozenset[str]:
    """Return the names of all files of the repository."""
    listed = subprocess.run(
        ["git", "ls-files", "-co", "--exclude-standard"], cwd=ROOT, capture_output=True, text=True, check=True
    )
    return frozenset(Path(line).name for line in listed.stdout.splitlines())


@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda p: str(p.relative_to(ROOT)))
def test_links_lead_somewhere(document: Path) -> None:
    broken = []
    for link in LINK.findall(document.read_text(encoding="utf-8")):
        if "://" in link:
            continue
        name, _, anchor = link.partition("#")
        target = (document.parent / name).resolve() if name else document
        if not target.exists() or (anchor and anchor not in anchors(target)):
            broken.append(link)
    assert not broken


@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda p: str(p.relative_to(ROOT)))
def test_named_files_exist(document: Path) -> None:
    named = {n for n in FILE.findall(document.read_text(encoding="utf-8")) if NEW not in n} - OF_RECORDINGS
    missing = {
        name
        for name in named
        if not (name in names() if "/" not in name else any((ROOT / start / name).exists() for start in PACKAGES))
    }
    assert not missing


@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda p: str(p.relative_to(ROOT)))
def test_lines_wrap(document: Path) -> None:
    """Rows of tables and lines of code cannot."""
    lines = enumerate(document.read_text(encoding="utf-8").splitlines(), start=1)
    long = [n for n, line in lines if len(line) > WIDTH and not line.startswith(("|", "    "))]
    assert not long


def test_the_site_has_every_page() -> None:
    site = (ROOT / "mkdocs.yml").read_text(encoding="utf-8")
    nav = yaml.safe_load(site[site.index("\nnav:") :])["nav"]
    listed = set(re.findall(r"[\w/-]+\.md", str(nav))) - {"contributing.md"}
    assert listed == {str(path.relative_to(ROOT / "docs")) for path in (ROOT / "docs").rglob("*.md")}


def test_the_site_is_built_without_a_warning(tmp_path: Path) -> None:
    """A formula that cannot be read, a broken reference to the code and a page that loads from elsewhere are errors."""
    if not (ROOT / "web/node_modules/katex").exists():
        pytest.skip("web/node_modules is not installed (make setup)")
    done = subprocess.run(
        [sys.executable, "-m", "mkdocs", "build", "--strict", "-q", "-d", tmp_path],
        cwd=ROOT,
        env={**os.environ, "NO_MKDOCS_2_WARNING": "1"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert not done.stderr
    assert 'class="katex-display"' in (tmp_path / "estimator.html").read_text(encoding="utf-8")
