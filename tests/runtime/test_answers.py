"""The answers to each sender of commands."""

from snakeslam.messages import GaitCommand
from snakeslam.runtime.bus.commands import EStop, SetGait, Start
from snakeslam.runtime.bus.sender import Sender
from snakeslam.runtime.robot.answers import OVERTAKEN, Answers


def test_an_estop_that_arrives_after_a_later_command_is_answered_as_what_it_is() -> None:
    """It has a topic of its own, on which it may be overtaken; obeyed, its answer must not be a refusal."""
    sender, answers = Sender(), Answers()
    estop = sender.stamped(EStop("now"), 0)
    later = sender.stamped(SetGait(GaitCommand(0, "pedal")), 0)
    answers.add(later, None)
    assert [(refusal.number, refusal.reason) for refusal in answers.all()[0].refusals] == [(estop.number, OVERTAKEN)]
    answers.add(estop, None)
    assert answers.all()[0].refusals == ()
    answers.add(sender.stamped(Start(), 0), "no")
    assert [refusal.reason for refusal in answers.all()[0].refusals] == ["no"]
