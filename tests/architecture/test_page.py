"""The page's modules import downwards only, in layers, and no gait is known to them by name or by formula."""

import re
from pathlib import Path

import pytest

from snakeslam.gaits.catalogue import GAITS

WEB = Path(__file__).parents[2] / "web"
SOURCE = WEB / "src"
LAYERS = ("generated", "types.ts", "basics", "drawing", "link", "app", "panels", "main.ts")
"""Low to high: a module imports from its own folder and those before it; siblings of a folder form no circle."""
ALONE = {"viewer-frame.ts"}
"""A program of its own: it runs in the frame of the 3D view."""


def modules() -> list[Path]:
    """Return the page's modules, relative to ``web/src``."""
    return sorted(path.relative_to(SOURCE) for path in SOURCE.rglob("*.ts"))


def imports(module: Path) -> list[Path]:
    """Return the modules that ``module`` imports, types and workers too."""
    text = (SOURCE / module).read_text(encoding="utf-8")
    named = re.findall(r'(?:from|import|import\(|new URL\() ?"(\.[^"]+)"', text)
    found = [((SOURCE / module).parent / name).resolve().relative_to(SOURCE) for name in named]
    return [
        path if path.suffix == ".ts" else path.with_name(f"{path.name}.ts") for path in found if path.suffix != ".css"
    ]


def layer(module: Path) -> int:
    return LAYERS.index(module.parts[0])


@pytest.mark.parametrize("module", [m for m in modules() if str(m) not in ALONE], ids=str)
def test_no_import_leads_uphill(module: Path) -> None:
    for imported in imports(module):
        assert (SOURCE / imported).exists(), imported
        assert layer(imported) <= layer(module), f"{module} imports {imported}"


def test_no_imports_form_a_circle() -> None:
    known = {module: imports(module) for module in modules()}
    while known:
        free = [module for module, needed in known.items() if not any(other in known for other in needed)]
        assert free, f"a circle among {sorted(map(str, known))}"
        for module in free:
            del known[module]


def test_each_panel_has_its_own_styles() -> None:
    """A file of styles is that of the panel of its name, or of the whole page."""
    styles = SOURCE / "styles"
    for path in (styles / "panels").glob("*.css"):
        panel = SOURCE / "panels" / f"{path.stem}.ts"
        assert f'"../styles/panels/{path.name}"' in panel.read_text(encoding="utf-8"), path.name
    main = (SOURCE / "main.ts").read_text(encoding="utf-8")
    assert {path.stem for path in styles.glob("*.css")} == set(re.findall(r'"\./styles/([\w-]+)\.css"', main))


def test_the_page_knows_no_gait() -> None:
    for module in modules():
        if module.parts[0] == "generated":
            continue
        text = (SOURCE / module).read_text(encoding="utf-8")
        for name in GAITS:
            assert f'"{name}"' not in text, f"{module} names the gait {name}"
        assert "bessel" not in text.lower(), module
