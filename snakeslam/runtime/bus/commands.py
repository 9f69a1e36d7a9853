"""Every command to a session, as one tagged union: from HTTP, teleop and scripts to the robot node or the player.

A command is a MessagePack map whose ``type`` names it; what has an unknown type or a field of another type is refused
where it is decoded (``codec``). The robot node alone decides whether a command is obeyed.
"""

from msgspec import Struct

from snakeslam.messages import GaitCommand, HeadCommand


class SetGait(Struct, frozen=True, tag=True):
    """Change the gait or its parameters; ``drive`` of ``gait`` is ignored: only Start and Stop set things moving."""

    gait: GaitCommand


class SetHead(Struct, frozen=True, tag=True):
    """Change the head's controller or its neck, or turn its reference line."""

    head: HeadCommand


class Start(Struct, frozen=True, tag=True):
    """Move."""


class BackUp(Struct, frozen=True, tag=True):
    """Play the gait backwards for ``safety.back_up_s``, blind or not, then stop."""


class Stop(Struct, frozen=True, tag=True):
    """Stop smoothly."""


class Drive(Struct, frozen=True, tag=True):
    """The deadman input: move at ``drive`` of the gait's pace and ``turn``, both in [-1, 1], while it is repeated.

    Without another within ``deadman.DEADMAN_S`` the robot is held; 0 releases it. ``deadman`` names the input among
    those of its sender, ``begins`` says that it was released before: a press that was refused, or ended by a hold, does
    not move the robot again until it is released (``deadman``).
    """

    drive: float
    turn: float = 0.0
    deadman: str = ""
    begins: bool = False


class EStop(Struct, frozen=True, tag=True):
    """Latch the emergency stop and hold."""

    reason: str


class ResetEStop(Struct, frozen=True, tag=True):
    """Clear the latch; never moves the robot."""


class ControlPlayback(Struct, frozen=True, tag=True):
    """Change how a recording plays; what is None stays as it is.

    ``speed`` is a multiple of real time, ``position_s`` counts from the first frame, ``step`` moves by so many frames
    (negative: back) and pauses.
    """

    paused: bool | None = None
    speed: float | None = None
    position_s: float | None = None
    step: int = 0


class Shutdown(Struct, frozen=True, tag=True):
    """End the session."""


RobotCommand = SetGait | SetHead | Start | BackUp | Stop | Drive | EStop | ResetEStop
"""What goes over the bus, as a ``SentCommand``."""
Command = RobotCommand | ControlPlayback | Shutdown
