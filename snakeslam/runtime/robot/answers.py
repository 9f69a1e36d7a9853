"""What the robot answers to each sender: the number of the last command it handled, and the last refusals."""

from collections import OrderedDict

from snakeslam.runtime.bus.topics import Answer, Refusal
from snakeslam.runtime.bus.wire import SentCommand

REFUSALS_KEPT = 8
SENDERS_KEPT = 8
OVERTAKEN = "a later command arrived before it"


class Answers:
    """The answers to the senders that were active last."""

    def __init__(self) -> None:
        self._answers: OrderedDict[str, tuple[int, tuple[Refusal, ...]]] = OrderedDict()

    def add(self, sent: SentCommand, refusal: str | None) -> None:
        """Add the outcome of ``sent``, None when it was obeyed; numbers that were skipped count as overtaken."""
        done, refusals = self._answers.pop(sent.sender, (0, ()))
        skipped = range(max(done + 1, sent.number - REFUSALS_KEPT), sent.number)
        added = [Refusal(number, OVERTAKEN) for number in skipped]
        # A command that counted as overtaken may still arrive: an E-stop has a topic of its own.
        refusals = tuple(earlier for earlier in refusals if earlier.number != sent.number)
        if refusal is not None:
            added.append(Refusal(sent.number, refusal))
        self._answers[sent.sender] = max(done, sent.number), (*refusals, *added)[-REFUSALS_KEPT:]
        while len(self._answers) > SENDERS_KEPT:
            self._answers.popitem(last=False)

    def all(self) -> tuple[Answer, ...]:
        """Return the answer to each sender."""
        return tuple(Answer(sender, *answer) for sender, answer in self._answers.items())
