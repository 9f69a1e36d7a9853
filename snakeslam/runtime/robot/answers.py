"""How far the robot is with each sender's commands, and the last refusals."""

from collections import OrderedDict

from snakeslam.runtime.bus.topics import Answer, Refusal
from snakeslam.runtime.bus.wire import Order

REFUSALS_KEPT = 8
SENDERS_KEPT = 8
OVERTAKEN = "a later command was there before it"


class Answers:
    """The answers to the senders heard last."""

    def __init__(self) -> None:
        self._done: OrderedDict[str, tuple[int, tuple[Refusal, ...]]] = OrderedDict()

    def note(self, order: Order, refusal: str | None) -> None:
        """Note that ``order`` is done with; those before it that never came have been overtaken."""
        done, refusals = self._done.pop(order.sender, (0, ()))
        missing = range(max(done + 1, order.number - REFUSALS_KEPT), order.number)
        told = [Refusal(number, OVERTAKEN) for number in missing]
        # An order that was given up, such as an E-stop that had a way of its own, has come after all.
        refusals = tuple(earlier for earlier in refusals if earlier.number != order.number)
        if refusal is not None:
            told.append(Refusal(order.number, refusal))
        self._done[order.sender] = max(done, order.number), (*refusals, *told)[-REFUSALS_KEPT:]
        while len(self._done) > SENDERS_KEPT:
            self._done.popitem(last=False)

    def all(self) -> tuple[Answer, ...]:
        """Return every sender's answer."""
        return tuple(Answer(sender, *answer) for sender, answer in self._done.items())
