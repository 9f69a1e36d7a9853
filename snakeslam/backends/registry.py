"""The backends that ``backend:`` in the settings can name; a new one is its package and one line here."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, Literal

from snakeslam.backends.kind import BackendKind
from snakeslam.backends.replay.kind import REPLAY
from snakeslam.backends.sim.kind import SIM

KINDS: tuple[BackendKind[Any], ...] = (SIM, REPLAY)

BACKENDS: Mapping[str, BackendKind[Any]] = {kind.name: kind for kind in KINDS}

RECORDINGS = REPLAY.name
"""What plays a recording that is named on the command line or the page."""

if TYPE_CHECKING:
    BackendName = str
else:
    BackendName = Literal[tuple(BACKENDS)]
