"""What changed, in words for the timeline."""

from snakeslam.head.catalogue import HEAD_CATALOGUE
from snakeslam.head.settings import HeadSettings
from snakeslam.messages import HeadCommand


def head_words(before: HeadSettings, after: HeadSettings, command: HeadCommand) -> list[str]:
    """Return one line for each thing that ``command`` changed of the head."""
    words: list[str] = []
    if after.controller != before.controller:
        words.append(f"head control: {HEAD_CATALOGUE[after.controller].title.lower()}")
    if after.neck_joints != before.neck_joints:
        words.append(f"neck of {after.neck_joints} yaw joints")
    if command.turn_by_deg:
        side = "left" if command.turn_by_deg > 0 else "right"
        words.append(f"turn by {abs(command.turn_by_deg):g} deg to the {side}")
    return words
