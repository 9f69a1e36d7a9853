"""How a backend is registered: its name, its settings, and how it is opened."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Generic, Literal, TypeVar

from snakeslam.settings import Settings

if TYPE_CHECKING:
    # The settings import this module, and settings import no mathematics.
    from snakeslam.backends.base import Backend, FrameSource
    from snakeslam.robot.model import SnakeModel

CameraUse = Literal["here", "elsewhere", "none"]
"""Frames are drawn by the backend, by a ``FrameSource`` in another process, or not at all."""
S = TypeVar("S", bound=Settings)


@dataclass(frozen=True, slots=True)
class BackendRequest(Generic[S]):
    """What a backend is opened with; a recording has its own robot and takes no notice of ``model``."""

    settings: S
    model: "SnakeModel"
    seed: int
    camera: CameraUse = "here"


@dataclass(frozen=True, slots=True)
class BackendKind(Generic[S]):
    """A backend that can be chosen by ``backend:`` in the settings.

    ``text`` is one line for the settings; ``settings`` names the group that its ``open`` gets, InputError where it
    cannot be opened. ``recorded``: it plays a recording, and takes no commands. With ``open_camera`` it can leave its
    frames to another process.
    """

    name: str
    text: str
    settings: str
    open: "Callable[[BackendRequest[S]], Backend]"
    open_camera: "Callable[[BackendRequest[S]], FrameSource] | None" = None
    recorded: bool = False
