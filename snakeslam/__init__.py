"""Gait control, visual-inertial SLAM and a browser dashboard for snake robots.

From Python: ``load_config``, ``run``, ``replay`` and ``study``, their results and their errors. They are loaded when
they are first used, so that importing the package costs nothing.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from snakeslam.api import replay as replay
    from snakeslam.api import run as run
    from snakeslam.api import study as study
    from snakeslam.config import Config as Config
    from snakeslam.config import load_config as load_config
    from snakeslam.errors import InputError as InputError
    from snakeslam.errors import SnakeslamError as SnakeslamError
    from snakeslam.studies.experiment import RunResult as RunResult
    from snakeslam.studies.metrics import Metrics as Metrics
    from snakeslam.studies.sweep import StudyResult as StudyResult

_HOMES = {
    "Config": "snakeslam.config",
    "InputError": "snakeslam.errors",
    "Metrics": "snakeslam.studies.metrics",
    "RunResult": "snakeslam.studies.experiment",
    "SnakeslamError": "snakeslam.errors",
    "StudyResult": "snakeslam.studies.sweep",
    "load_config": "snakeslam.config",
    "replay": "snakeslam.api",
    "run": "snakeslam.api",
    "study": "snakeslam.api",
}
"""Where each public name is defined."""

__all__ = [
    "Config",
    "InputError",
    "Metrics",
    "RunResult",
    "SnakeslamError",
    "StudyResult",
    "load_config",
    "replay",
    "run",
    "study",
]


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(_HOMES[name]), name)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
