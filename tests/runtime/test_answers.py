"""What a sender hears of its commands."""

from snakeslam.messages import GaitCommand
from snakeslam.runtime.bus.commands import EStop, SetGait, Start
from snakeslam.runtime.bus.orders import Sender
from snakeslam.runtime.robot.answers import OVERTAKEN, Answers


def test_an_estop_that_comes_after_a_later_command_is_answered_as_what_it_is() -> None:
    """It has a topic of its own, on which it may be overtaken; obeyed, it must not be told as refused."""
    sender, answers = Sender(), Answers()
    estop = sender.order(EStop("now"), 0)
    later = sender.order(SetGait(GaitCommand(0, "pedal")), 0)
    answers.note(later, None)
    assert [(refusal.number, refusal.reason) for refusal in answers.all()[0].refusals] == [(estop.number, OVERTAKEN)]
    answers.note(estop, None)
    assert answers.all()[0].refusals == ()
    answers.note(sender.order(Start(), 0), "no")
    assert [refusal.reason for refusal in answers.all()[0].refusals] == ["no"]
