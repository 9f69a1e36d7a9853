"""The text of ``configs/sim.yaml``, generated from the settings by ``make configs``."""

import sys
import textwrap
from inspect import isclass

import yaml

from snakeslam.config import Config
from snakeslam.settings import Settings

WIDTH = 120
HEADER = (
    "The simulator: every setting with its default. Change a copy, or one value: --set gait.name=arc_rolling",
    "This file is generated from the settings' own documentation: make configs.",
)


def sim_yaml() -> str:
    """Return every setting with its default value and, as a comment, its documentation."""
    return "\n".join([*(f"# {line}" for line in HEADER), *_section(Config(), 0)]) + "\n"


def _section(settings: Settings, depth: int) -> list[str]:
    """Return the lines of a group of settings; the groups of the file's first level are set apart by a blank line."""
    indent = "  " * depth
    lines: list[str] = []
    for name, field in type(settings).model_fields.items():
        value = getattr(settings, name)
        group = isclass(field.annotation) and issubclass(field.annotation, Settings)
        text = field.description or (value.__doc__.split("\n\n")[0] if group else "")
        comment = textwrap.wrap(
            " ".join(text.replace("``", "").split()), WIDTH - len(indent) - 2, break_on_hyphens=False
        )
        lines += [""] if depth == 0 else []
        lines += [f"{indent}# {line}" for line in comment]
        if group:
            lines += [f"{indent}{name}:", *_section(value, depth + 1)]
        else:
            shown = yaml.safe_dump(settings.model_dump(mode="json")[name], default_flow_style=True).split("\n")[0]
            lines.append(f"{indent}{name}: {shown}")
    return lines


if __name__ == "__main__":
    sys.stdout.write(sim_yaml())
