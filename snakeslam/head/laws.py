"""The closed-form head controllers as shapes of the whole body: a gait and its phase in, joint angles out.

They hold for a gait that winds as a serpenoid curve; every other gait keeps its own angles. The gait of Eq. (1) winds
as the heading phi(s) = -alpha cos(b s + sigma), the mirror image of the paper's, with alpha = A_o / (2 sin(b l0)).
"""

from contextlib import suppress
from dataclasses import dataclass

import numpy as np

from snakeslam.errors import InputError
from snakeslam.gaits.gait import ResolvedGait
from snakeslam.gaits.posture import posed_angles
from snakeslam.gaits.serpenoid import alpha_from_amplitude
from snakeslam.head import direction, position
from snakeslam.head.catalogue import HEAD_CATALOGUE
from snakeslam.head.neck import Neck, most_neck_joints, neck_joints_of, neck_of
from snakeslam.head.settings import HeadController, HeadSettings
from snakeslam.messages import Float
from snakeslam.robot.model import SnakeModel

SLOPE_STEP_RAD = 1e-4
PHASES = 72
"""Phases at which the neck's largest angle is looked for."""


@dataclass(frozen=True, slots=True)
class HeadShape:
    """A gait under a closed-form controller; ``predictive`` has the shape of ``position``, from which it departs."""

    controller: HeadController
    model: SnakeModel
    neck: Neck

    def angles(self, gait: ResolvedGait, sigma: float) -> Float:
        """Return the angles, (N,) rad."""
        q_rad, _ = posed_angles(gait, self.model, sigma)
        if self._holds(gait):
            q_rad[self.neck.joints] = self._neck_angles(gait, sigma)
        return q_rad

    def __call__(self, gait: ResolvedGait, sigma: float) -> tuple[Float, Float]:
        """Return the angles and their slope d/d(sigma), each (N,)."""
        q_rad, slope = posed_angles(gait, self.model, sigma)
        if self._holds(gait):
            q_rad[self.neck.joints] = self._neck_angles(gait, sigma)
            ahead, behind = (self._neck_angles(gait, sigma + h) for h in (SLOPE_STEP_RAD, -SLOPE_STEP_RAD))
            slope[self.neck.joints] = (ahead - behind) / (2.0 * SLOPE_STEP_RAD)
        return q_rad, slope

    def _holds(self, gait: ResolvedGait) -> bool:
        return self.controller != "none" and steers_head(gait)

    def _neck_angles(self, gait: ResolvedGait, sigma: float) -> Float:
        return neck_angles(self.controller, gait, self.model, self.neck, sigma)


def steers_head(gait: ResolvedGait) -> bool:
    """Return whether the closed forms hold for this gait: they are made for the serpenoid curve."""
    return gait.kind.head_form == "line"


def feeds_back(controller: HeadController, gait: ResolvedGait) -> bool:
    """Return whether the neck follows the estimate in this gait; in some gaits the phase moves it instead."""
    return controller == "predictive" and gait.kind.head_form != "carried"


def effect(controller: HeadController, gait: ResolvedGait) -> str:
    """Return in one sentence what a controller does in ``gait``."""
    if controller == "none" or steers_head(gait):
        return HEAD_CATALOGUE[controller].summary
    if not feeds_back(controller, gait):
        return "No effect in this gait: the head moves with the body."
    return "Feedback keeps the head level and looking ahead" + (", but for its roll." if gait.rolls else ".")


def neck_angles(controller: HeadController, gait: ResolvedGait, model: SnakeModel, neck: Neck, sigma: float) -> Float:
    """Return the angles of the neck's joints, (n,) rad; the steering offset beta_o of a gait bends the neck as well."""
    wave, l0 = gait.shape, model.joint_length_m
    alpha = -alpha_from_amplitude(wave.amplitude_o, 2.0 * np.pi / wave.k_o)
    b = wave.k_o / l0
    u = b * neck.s_M_m + wave.harmonic_o * sigma
    phi_M = float(alpha * np.cos(u))
    if controller == "direction":
        headings = direction.arc_heading(phi_M, neck.sections_m, neck.s_M_m, neck.s_N_m)
    else:
        f_M = position.difference(position.lateral_position_m(alpha, b, u), phi_M, neck.length_m)
        headings = position.heading(phi_M, f_M, neck.sections_m, neck.s_M_m, neck.s_N_m)
    return wave.beta_o + direction.joint_angles(headings)


def check(settings: HeadSettings, model: SnakeModel, gait: ResolvedGait) -> None:
    """Raise InputError for a neck that the body does not have, or whose joints would have to bend too far."""
    count = neck_joints_of(settings, model)
    neck = neck_of(model, count)
    if settings.controller == "none" or not steers_head(gait):
        return
    largest = largest_neck_angle(settings.controller, gait, model, neck)
    limit = model.limits.position_rad
    if largest > limit:
        raise InputError(
            "head.neck_joints",
            f"{count} yaw joints would bend {np.rad2deg(largest):.0f} deg in this gait",
            f"at most {np.rad2deg(limit):.0f} deg: more neck joints, or less gait.alpha_pi",
        )


def settled(settings: HeadSettings, model: SnakeModel, gait: ResolvedGait) -> HeadSettings:
    """Return the settings with the neck's length filled in: the shortest from a third of the yaw joints that ``gait``
    does not bend too far. InputError where there is none, or where the length given is too short.
    """
    if settings.neck_joints is not None:
        check(settings, model, gait)
        return settings
    for count in range(neck_joints_of(settings, model), most_neck_joints(model)):
        longer = settings.model_copy(update={"neck_joints": count})
        with suppress(InputError):
            check(longer, model, gait)
            return longer
    longest = settings.model_copy(update={"neck_joints": most_neck_joints(model)})
    check(longest, model, gait)
    return longest


def largest_neck_angle(controller: HeadController, gait: ResolvedGait, model: SnakeModel, neck: Neck) -> float:
    """Return the largest angle of a neck joint over a period, in rad."""
    sigmas = np.linspace(0.0, 2.0 * np.pi, PHASES, endpoint=False)
    angles = [neck_angles(controller, gait, model, neck, float(sigma)) for sigma in sigmas]
    return float(np.max(np.abs(angles)))
