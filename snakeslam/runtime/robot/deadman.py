"""The deadman limit, and which deadman input may move the robot; pure, with the time given.

A robot that is driven by hand moves only while its operator keeps saying so. A *deadman input* is one source of drive
commands, such as the socket of a page or a script. Its *press* lasts from the first drive that is not zero to the next
zero, its *release*. After a hold, an E-stop or a stop the input that moved the robot must be released before it may
move the robot again, so that a key that is still held down starts nothing.

| event | the input that moves the robot | the other inputs |
|---|---|---|
| a drive that begins a press, or the first one after a release | this one | must be released first |
| a release | none; this input is released | as before |
| a hold, an E-stop, a stop, or silence of the input | none; it must be released first | as before |
| a restart of the robot node | none | must be released first: only their senders know since when they are pressed |
"""

from collections import OrderedDict

DEADMAN_S = 0.3
"""The age at which anything that keeps the robot moving no longer counts: a drive, another command, a heartbeat.

The brake takes 0.15 s at most, so a robot stands still within 0.45 s. This is the only place where the limit is set.
"""
DEADMAN_NS = round(DEADMAN_S * 1e9)
INPUT_SILENT = "the drive input fell silent"
RELEASE_FIRST = "the drive was held down while the robot was held or started again: release it first"
INPUTS_KEPT = 64


class DeadmanInputs:
    """Keeps which input moves the robot, and which ones have been released; see the table of the module."""

    def __init__(self) -> None:
        self._active: str | None = None
        self._newest_ns: int | None = None
        self._released: OrderedDict[str, None] = OrderedDict()

    def refusal(self, name: str, begins: bool) -> str | None:
        """Return why the input ``name`` may not move the robot; None when it may.

        ``begins`` says that its sender has seen it released before this drive.
        """
        return None if begins or name == self._active or name in self._released else RELEASE_FIRST

    def moves(self, name: str) -> bool:
        """Return whether it is the input ``name`` that moves the robot."""
        return name == self._active

    def press(self, name: str, now_ns: int) -> None:
        """Let the input ``name`` move the robot; its newest drive came at ``now_ns`` of the robot's time."""
        self._released.pop(name, None)
        self._active, self._newest_ns = name, now_ns

    def refuse(self, name: str) -> None:
        """Note that a press of ``name`` was refused: it must be released before it may move the robot."""
        self._released.pop(name, None)
        if name == self._active:
            self.end_press()

    def release(self, name: str) -> None:
        """Note that ``name`` was released; the press of whichever input moves the robot ends too."""
        self.end_press()
        self._released[name] = None
        while len(self._released) > INPUTS_KEPT:
            self._released.popitem(last=False)

    def end_press(self) -> None:
        """Note that the robot is held or stopped: the input that moved it must be released first."""
        self._active = self._newest_ns = None

    def start(self) -> None:
        """Note that a start moves the robot: it needs no input from now on, and the active one may go on."""
        self._newest_ns = None

    def silent(self, now_ns: int) -> bool:
        """Return whether the input that moves the robot has sent nothing for longer than the deadman limit."""
        return self._newest_ns is not None and now_ns - self._newest_ns > DEADMAN_NS
