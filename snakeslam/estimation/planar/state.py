"""The paper's 5-D filter in the plane, Eq. (37)-(41): predicted by the gait's motion model, corrected by a pose.

The robot is represented by its virtual chassis V (``planar.motion``); the observed pose is that of the IMU in its head,
(x, y, yaw).
"""

from dataclasses import dataclass

import numpy as np

from snakeslam.estimation.planar.models import Twist
from snakeslam.estimation.planar.motion import BodyShape, rotation
from snakeslam.messages import Float

P, THETA, SPEED, OMEGA = slice(0, 2), 2, 3, 4
SIZE = 5
PERP = np.array([[0.0, -1.0], [1.0, 0.0]])
SMALL_STEP = 1e-9
"""Norm of the step, m and rad, at which the iteration has converged."""
ROUNDING = 1e-9
"""Relative rise of the cost that is rounding and not divergence."""


@dataclass(frozen=True, slots=True)
class ControlInput:
    """The control input u of Eq. (38): speed and yaw rate by the motion model, now and one step before.

    ``direction_rad`` is the direction of motion against the heading. ``keep`` is the share of the difference between
    state and model that remains after the step. ``sigma_v`` m/s and ``sigma_omega`` rad/s are the sigmas of the model's
    errors, which last; ``sigma_across`` m/sqrt(s) is that of the speed across, which is not a state: white noise.
    """

    speed: float
    omega: float
    speed_before: float
    omega_before: float
    direction_rad: float
    keep: float
    sigma_v: float
    sigma_omega: float
    sigma_across: float


class PlanarState:
    """Eq. (37): x = [p_x, p_y, theta, v, omega] with its covariance ``cov`` (5, 5).

    ``p`` m is the centre of mass in W, ``theta`` rad the mean heading, ``v`` m/s the speed in the direction of motion,
    ``omega`` rad/s the yaw rate.
    """

    def __init__(self, x: Float, cov: Float) -> None:
        self.x, self.cov = np.array(x, dtype=np.float64), np.array(cov, dtype=np.float64)

    @staticmethod
    def at(head: Float, shape: BodyShape, cov: Float) -> "PlanarState":
        """Return the stationary state whose head is at (x, y, yaw) ``head`` (3,)."""
        theta = head[2] - shape.yaw_rad
        return PlanarState(np.array([*(head[:2] - rotation(theta) @ shape.r_V), theta, 0.0, 0.0]), cov)

    def predict(self, u: ControlInput, dt_s: float, slip_time_s: float) -> None:
        """Eq. (40): x = f(x, u, dt), P = F P F^T + G Q G^T, F and G at x_{k-1|k-1}."""
        F, G = transition(self.x, u, dt_s)
        # Errors that last for tau are white noise of variance sigma^2 2 dt / tau.
        self.x = move(self.x, u, dt_s)
        share = 2.0 * dt_s / slip_time_s
        Q = np.diag([u.sigma_v**2 * share, u.sigma_omega**2 * share, u.sigma_across**2 / dt_s])
        self.cov = F @ self.cov @ F.T + G @ Q @ G.T

    def head(self, shape: BodyShape) -> tuple[Float, Float]:
        """Return the head's (x, y, yaw) (3,) and its covariance (3, 3)."""
        H = observation_jacobian(self.x, shape)
        return observe(self.x, shape), H @ self.cov @ H.T

    def update(self, z: Float, R: Float, shape: BodyShape, max_iterations: int) -> int:
        """Eq. (41) with its iteration, for a pose z (3,) of the head with covariance R (3, 3); return the iterations.

        x_{j+1} = x^ + K_j [ z - h(x_j) - H_j (x^ - x_j) ], until the step is small; a step that raises the cost
        d^T P^-1 d + r^T R^-1 r is undone. Then P = (I - K H) P (I - K H)^T + K R K^T, Joseph's form of (I - K H) P.
        """
        prior, x = self.x, self.x
        r = wrapped(z - observe(x, shape))
        H = observation_jacobian(x, shape)
        cost = float(r @ np.linalg.solve(R, r))
        iterations = 0
        while iterations < max_iterations:
            iterations += 1
            # d = P H^T y with y = (H P H^T + R)^-1 (r_j + H (x_j - x^)), so that d^T P^-1 d = y^T H d.
            y = np.linalg.solve(H @ self.cov @ H.T + R, r - H @ (prior - x))
            d = self.cov @ H.T @ y
            r_new = wrapped(z - observe(prior + d, shape))
            cost_new = float(y @ H @ d + r_new @ np.linalg.solve(R, r_new))
            if cost_new > cost * (1.0 + ROUNDING):
                break
            step, x, r, cost = prior + d - x, prior + d, r_new, cost_new
            H = observation_jacobian(x, shape)
            if np.linalg.norm(step) < SMALL_STEP:
                break
        K = np.linalg.solve(H @ self.cov @ H.T + R, H @ self.cov).T
        keep = np.eye(SIZE) - K @ H
        self.x = x
        self.cov = keep @ self.cov @ keep.T + K @ R @ K.T
        return iterations


def move(x: Float, u: ControlInput, dt_s: float) -> Float:
    """Return f(x, u, dt), Eq. (38): p += v dt (cos, sin)(theta + direction), theta += omega dt.

    v and omega change as the motion model does, v = v_model + keep (v - v_model before); p moves in the direction at
    the middle of the step.
    """
    v = u.speed + u.keep * (x[SPEED] - u.speed_before)
    omega = u.omega + u.keep * (x[OMEGA] - u.omega_before)
    direction = x[THETA] + 0.5 * omega * dt_s + u.direction_rad
    p = x[P] + v * dt_s * np.array([np.cos(direction), np.sin(direction)])
    return np.array([*p, x[THETA] + omega * dt_s, v, omega])


def transition(x: Float, u: ControlInput, dt_s: float) -> tuple[Float, Float]:
    """Return F = df/dx (5, 5) and G = df/dw (5, 3) of Eq. (40), w the errors of speed, yaw rate and speed across."""
    _, _, _, v, omega = move(x, u, dt_s)
    direction = x[THETA] + 0.5 * omega * dt_s + u.direction_rad
    along = np.array([np.cos(direction), np.sin(direction)])
    across = PERP @ along
    G = np.zeros((SIZE, 3))
    G[P, 0], G[SPEED, 0] = along * dt_s, 1.0
    G[P, 1], G[THETA, 1], G[OMEGA, 1] = 0.5 * v * dt_s**2 * across, dt_s, 1.0
    G[P, 2] = across * dt_s
    F = np.eye(SIZE)
    F[P, THETA] = v * dt_s * across
    F[:, SPEED], F[:, OMEGA] = u.keep * G[:, 0], u.keep * G[:, 1]
    return F, G


def observe(x: Float, shape: BodyShape) -> Float:
    """Return h(x) of Eq. (39), the head's (x, y, yaw): p + R(theta) r_V and theta + yaw of the head on the body."""
    return np.array([*(x[P] + rotation(x[THETA]) @ shape.r_V), x[THETA] + shape.yaw_rad])


def observation_jacobian(x: Float, shape: BodyShape) -> Float:
    """Return dh/dx (3, 5) of Eq. (39)."""
    H = np.zeros((3, SIZE))
    H[P, P] = np.eye(2)
    H[P, THETA] = PERP @ rotation(x[THETA]) @ shape.r_V
    H[2, THETA] = 1.0
    return H


def wrapped(pose: Float) -> Float:
    """Return a difference of poses with its angle in (-pi, pi]."""
    return np.array([pose[0], pose[1], np.arctan2(np.sin(pose[2]), np.cos(pose[2]))])


def speed_and_direction(twist_V: Twist) -> tuple[float, float]:
    """Return the speed and the direction of a motion in V, in (-pi, pi] from the heading; 0 without motion."""
    speed = float(np.hypot(*twist_V.v))
    return speed, float(np.arctan2(twist_V.v[1], twist_V.v[0])) if speed > 0.0 else 0.0
