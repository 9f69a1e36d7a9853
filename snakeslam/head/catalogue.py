"""The head controllers as the operator sees them."""

from dataclasses import dataclass

from snakeslam.head.settings import HeadController


@dataclass(frozen=True, slots=True)
class HeadEntry:
    """One controller; ``steers``: the head's reference line can be turned, and the robot follows it."""

    name: HeadController
    title: str
    summary: str
    steers: bool = False


HEAD_CATALOGUE: dict[HeadController, HeadEntry] = {
    entry.name: entry
    for entry in (
        HeadEntry("none", "Off", "The neck moves as the gait does, and the head swings with it."),
        HeadEntry("direction", "Direction", "The neck bends in one arc that keeps the head's heading."),
        HeadEntry(
            "position",
            "Direction + position",
            "The neck bends in two arcs that keep the head's heading and its place beside the line.",
        ),
        HeadEntry(
            "predictive",
            "Predictive",
            "Foresees how the body yields and corrects by gyroscope and estimate; its line can be turned.",
            steers=True,
        ),
    )
}
