"""What a live session runs."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from snakeslam.backends.base import Backend
from snakeslam.config import Config
from snakeslam.estimation.settings import Mode
from snakeslam.runtime.bus.link import Link


@dataclass(frozen=True, slots=True)
class SessionSpec:
    """What a session runs: the backend of ``config``, or the ``recording`` when there is one.

    ``estimator_mode`` None is the configured one, for a recording the one that its sensors allow. A session with an
    ``estop_reason`` starts latched; with ``autostart`` the gait starts after ``run.rest_s``. ``build`` builds the
    backend, in the child process. With ``link`` the robot's nodes run elsewhere, with settings of their own.
    """

    config: Config
    recording: Path | None = None
    estimator_mode: Mode | None = None
    estop_reason: str | None = None
    autostart: bool = False
    build: "Callable[[SessionSpec], Backend] | None" = None
    link: Link | None = None
