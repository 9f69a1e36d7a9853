"""Commands and their effects in words, for the timeline and the log."""

from snakeslam.head.catalogue import HEAD_CATALOGUE
from snakeslam.head.settings import HeadSettings
from snakeslam.messages import HeadCommand
from snakeslam.runtime.bus.commands import BackUp, Drive, EStop, ResetEStop, RobotCommand, SetGait, SetHead, Start, Stop

NAMES: dict[type, str] = {
    SetGait: "the gait", SetHead: "the head", Start: "the start", BackUp: "the back-up", Stop: "the stop",
    Drive: "the drive", EStop: "the E-stop", ResetEStop: "the reset",
}  # fmt: skip


def describe_command(command: RobotCommand) -> str:
    """Return what ``command`` is called."""
    return NAMES[type(command)]


def describe_head_change(before: HeadSettings, after: HeadSettings, command: HeadCommand) -> list[str]:
    """Return one line for each thing that ``command`` changed of the head."""
    lines: list[str] = []
    if after.controller != before.controller:
        lines.append(f"head control: {HEAD_CATALOGUE[after.controller].title.lower()}")
    if after.neck_joints != before.neck_joints:
        lines.append(f"neck of {after.neck_joints} yaw joints")
    if command.turn_by_deg:
        side = "left" if command.turn_by_deg > 0 else "right"
        lines.append(f"turn by {abs(command.turn_by_deg):g} deg to the {side}")
    return lines
