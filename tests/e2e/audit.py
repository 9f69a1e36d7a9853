"""Faults of the page that can be read off it: what axe-core finds, and what lies on something else."""

from playwright.sync_api import Page

from tests.conftest import CHECKOUT

AXE = CHECKOUT / "web" / "node_modules" / "axe-core" / "axe.min.js"
# The 3D view is viser's page, of which only the image is shown.
RUN_AXE = """async () => {
    const options = {
        runOnly: ['wcag2a', 'wcag2aa', 'wcag21a', 'wcag21aa', 'wcag22aa', 'best-practice'],
        rules: {'label-content-name-mismatch': {enabled: true}, 'target-size': {enabled: true}},
    };
    const {violations} = await axe.run({exclude: [['#viewer']]}, options);
    return violations.map(({id, nodes}) => `${id}: ${nodes.map(({html}) => html.slice(0, 90)).join(' | ')}`);
}"""
# What lies over the 3D view and below it: no two may share a pixel, none may leave the screen's width.
COLLISIONS = """() => {
    const parts = [...document.querySelectorAll(
        '#player > *, #patrol, #view-loading, .view-tool, .view-legend, .scale-bar, .compass')]
        .filter((e) => e.checkVisibility())
        .map((e) => [e.id || e.className, e.getBoundingClientRect()]);
    const found = parts.filter(([, r]) => r.left < 0 || r.right > innerWidth).map(([name]) => `${name}: too wide`);
    parts.forEach(([name, a], index) => parts.slice(index + 1).forEach(([other, b]) => {
        const apart = a.right <= b.left || b.right <= a.left || a.bottom <= b.top || b.bottom <= a.top;
        if (!apart) found.push(`${name} on ${other}`);
    }));
    return found;
}"""


class Audit:
    """Runs axe-core in one page after another, in these themes; collects what it finds and in which state."""

    def __init__(self, *themes: str) -> None:
        self.themes = themes
        self.found: list[str] = []
        self.states = 0

    def check(self, page: Page, state: str) -> None:
        page.evaluate(AXE.read_text())
        for theme in self.themes:
            page.evaluate(f"document.documentElement.dataset.theme = '{theme}'")
            self.found += [f"{state}, {theme}: {line}" for line in page.evaluate(RUN_AXE)]
        self.states += 1
