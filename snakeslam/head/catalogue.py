"""The head controllers as they are shown to the operator."""

from dataclasses import dataclass

from snakeslam.head.settings import HeadController


@dataclass(frozen=True, slots=True)
class HeadEntry:
    """One controller; ``steers``: the head's reference line can be rotated, and the robot follows it."""

    name: HeadController
    title: str
    summary: str
    steers: bool = False


HEAD_CATALOGUE: dict[HeadController, HeadEntry] = {
    entry.name: entry
    for entry in (
        HeadEntry("none", "Off", "The head swings with the body."),
        HeadEntry("direction", "Direction", "One arc of the neck keeps the head's heading."),
        HeadEntry(
            "position",
            "Direction + position",
            "Two arcs of the neck keep heading and position.",
        ),
        HeadEntry(
            "predictive",
            "Predictive",
            "Model and feedback keep the head on a line.",
            steers=True,
        ),
    )
}
