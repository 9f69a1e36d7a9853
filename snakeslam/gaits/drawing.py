"""A gait's body over one period as points, for a page that draws it without knowing any formula.

Every sample is a shape in its own level frame: x along the body from tail to head, y to its left, z up from the
ground. The axes are the principal axes of the body's points, continuous from sample to sample, so that a rolling body
is seen to roll and a winding one does not rock.
"""

from dataclasses import dataclass

import numpy as np

from snakeslam.gaits.gait import ResolvedGait
from snakeslam.gaits.parametric import joint_angles
from snakeslam.messages import Float
from snakeslam.robot.kinematics import link_poses
from snakeslam.robot.model import SnakeModel

SAMPLES = 32
"""Shapes per period: enough for a drawing of a few centimetres that is interpolated between them."""
SQUARINGS = 5
"""32 steps of the power iteration. Where two directions spread alike it stays near the sample before, as it should."""


@dataclass(frozen=True, slots=True)
class GaitDrawing:
    """``points`` (S, N + 2, 3) from the tail's end to the head's tip, in joint lengths, at S equal steps of the phase
    over one period; ``backs`` (S, N + 1) how far each link's back faces up, 1, or down, -1.
    """

    points: Float
    backs: Float


def draw(gait: ResolvedGait, model: SnakeModel, samples: int = SAMPLES) -> GaitDrawing:
    """Return the drawing of ``gait`` by a robot of as many joints as ``model``, without its raised head."""
    phases = 2.0 * np.pi * np.arange(samples) / samples
    q_rad = np.stack([joint_angles(gait.shape, model.joint_count, float(phase)) for phase in phases])
    Ts = link_poses(model, q_rad, np.eye(4))
    tips = Ts[:, -1, :3, 3] + model.joint_length_m * Ts[:, -1, :3, 0]
    chains = np.concatenate([Ts[:, :, :3, 3], tips[:, None]], axis=1) / model.joint_length_m
    chains = chains - chains.mean(axis=1, keepdims=True)
    side = np.array([0.0, 1.0, 0.0])
    # The first pass only finds the frame in which the period closes.
    for chain in chains:
        _, side = _level_axes(chain, side)
    points, backs = np.empty_like(chains), np.empty(Ts.shape[:2])
    for n, chain in enumerate(chains):
        axes, side = _level_axes(chain, side)
        points[n] = chain @ axes.T
        points[n, :, 2] -= points[n, :, 2].min()
        backs[n] = Ts[n, :, :3, 2] @ axes[2]
    return GaitDrawing(points, backs)


def _level_axes(chain: Float, side: Float) -> tuple[Float, Float]:
    """Return the axes (forward, left, up) (3, 3) of centred points (M, 3), and the left one to go on from."""
    tail_to_head = _unit(chain[-1] - chain[0])
    forward = _widest(chain, tail_to_head)
    forward = forward * (1.0 if forward @ tail_to_head >= 0.0 else -1.0)
    guess = _unit(side - (side @ forward) * forward)
    flat = chain - np.outer(chain @ forward, forward)
    left = _widest(flat, guess)
    left = left * (1.0 if left @ guess >= 0.0 else -1.0)
    return np.stack([forward, left, np.cross(forward, left)]), left


def _widest(points: Float, guess: Float) -> Float:
    """Return the direction in which centred points (M, 3) spread most, (3,), by power iteration from ``guess``."""
    power = points.T @ points
    # Squared instead of iterated: the covariance to the power of 2^SQUARINGS, scaled against overflow.
    for _ in range(SQUARINGS):
        largest = np.abs(power).max()
        if largest < 1e-9:
            return guess
        power = (power / largest) @ (power / largest)
    axis = power @ guess
    return _unit(axis) if np.linalg.norm(axis) > 1e-9 else guess


def _unit(v: Float) -> Float:
    return v / (np.linalg.norm(v) or 1.0)
